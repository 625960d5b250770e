"""What the table says: spreads, equal budgets, what is missing and why."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from svbrdfgan.experiments.columns import Column
from svbrdfgan.experiments.outcome import RunOutcome
from svbrdfgan.experiments.results import FinishedRun, Results, TableLine
from svbrdfgan.experiments.run_matrix import RunMatrix
from svbrdfgan.experiments.table import page, write_results

MakeMatrix = Callable[..., RunMatrix]
MakeOutcome = Callable[..., RunOutcome]


def results(matrix: RunMatrix, outcomes: Mapping[tuple[str, str], list[RunOutcome | str]]) -> Results:
    """Lines with these outcomes, or reasons for having failed."""
    lines = []
    for name, row in matrix.experiment.rows.items():
        for recipe in matrix.recipes(row):
            runs = [
                FinishedRun(seed, Path(f"{name}-{recipe}-{seed}"), reason=found)
                if isinstance(found, str)
                else FinishedRun(seed, Path(f"{name}-{recipe}-{seed}"), outcome=found)
                for seed, found in enumerate(outcomes.get((name, recipe), []))
            ]
            lines.append(TableLine(name, recipe, tuple(runs)))
    return Results(matrix, tuple(lines))


def cells(text: str, row: str, recipe: str, table: int = 0) -> dict[str, str]:
    """A line of one of the tables, by heading."""
    header = [line for line in text.splitlines() if line.startswith("| row |")][table]
    body = text.split(header)[1].split("\n\n")[0].splitlines()
    found = next(line for line in body if line.startswith(f"| {row} | {recipe} |"))
    head, line = ([cell.strip() for cell in each.split("|")[1:-1]] for each in (header, found))
    return dict(zip(head, line, strict=True))


def test_mean_and_spread(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    text = page(results(make_matrix(), {("none", "default"): [outcome(0.5), outcome(0.7)]}), pictures=False)
    line = cells(text, "none", "default")
    assert line["seeds"] == "2"
    assert line["recovered"] == "0.600 ± 0.141"  # of a sample: divided by n - 1
    assert line["of the oracle"] == "0.75 ± 0.18"
    assert line["seen"] == "90% ± 0%"
    assert "Mean ± standard deviation" in text


def test_one_seed_has_no_spread(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    text = page(results(make_matrix(), {("none", "default"): [outcome(0.5)]}), pictures=False)
    assert cells(text, "none", "default")["recovered"] == "0.500"
    assert "small differences mean nothing" in text


def test_equal_budgets_are_the_least_of_all_runs(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    fast = outcome(history=((1000, 5.0, 0.3), (2000, 10.0, 0.6), (8000, 40.0, 0.7)))
    slow = outcome(history=((500, 15.0, 0.2), (1500, 45.0, 0.4), (2000, 60.0, 0.5)))
    text = page(results(make_matrix(), {("none", "default"): [fast], ("none", "thesis"): [slow]}), pictures=False)
    first, second = cells(text, "none", "default", 1), cells(text, "none", "thesis", 1)
    assert (first["at 2,000 images"], second["at 2,000 images"]) == ("0.600", "0.500")
    assert (first["at 40 s"], second["at 40 s"]) == ("0.700", "0.200")
    assert (first["images"], second["seconds"]) == ("8,000", "60")


def test_half_way_is_averaged_over_runs_that_got_there(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    never = outcome(history=((100, 10.0, 0.0), (300, 30.0, 0.1)))
    found = {("none", "default"): [outcome(), never], ("some", "default"): [never]}
    text = page(results(make_matrix(), found), pictures=False)
    assert cells(text, "none", "default", 1)["images to half"] == "200 (1 of 2)"
    assert cells(text, "some", "default", 1)["seconds to half"] == "never"


def test_what_is_missing_is_reported(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    found = {("none", "default"): [outcome(), "a loss is not finite."], ("some", "default"): ["out of memory"]}
    text = page(results(make_matrix(), found), pictures=False)
    assert cells(text, "none", "default")["seeds"] == "1"
    assert "| some |" not in text
    assert "- none, default, seed 1: failed: a loss is not finite." in text
    assert "- some, default, seed 0: failed: out of memory" in text
    assert "Not run yet: none, thesis; some, thesis; fewer, default." in text


def test_names_and_reasons_of_strangers_stay_in_their_line(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    found = {("none", "default"): [outcome().model_copy(update={"device": "a\x1b[31m"}), "no\n# Title\x1b]0;a\x07"]}
    text = page(results(make_matrix(), found), pictures=False)
    assert r"failed: no\n# Title\x1b]0;a\x07" in text
    assert "\x1b" not in text


def test_what_cannot_be_compared_is_reported(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    found = {("none", "default"): [outcome(jobs=1)], ("some", "default"): [outcome(jobs=4, plateau=False)]}
    text = page(results(make_matrix(), found), pictures=False)
    assert "CPU, 1 at once; CPU, 4 at once. These differ" in text
    assert "still rising in: some, default." in text


def test_versions_that_differ_are_reported(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    old, new = (outcome().model_copy(update={"versions": {"svbrdfgan": number}}) for number in ("0.1", "0.2"))
    mixed, alike = (results(make_matrix(), {("none", "default"): found}) for found in ([old, new], [new, new]))
    assert "Several versions made them: svbrdfgan 0.1; svbrdfgan 0.2." in page(mixed, pictures=False)
    assert "Several versions" not in page(alike, pictures=False)


def test_every_row_and_column_is_explained(make_matrix: MakeMatrix, outcome: MakeOutcome) -> None:
    made = results(make_matrix("train.minutes=1", measures=["unseen"]), {("none", "default"): [outcome()]})
    text = page(made, pictures=True)
    assert "All rows differ from that by `train.minutes=1`." in text
    assert "- **some**: Some noise. Sets `train.scenes.camera_noise_degrees=5`." in text
    for column in [*made.verdicts(), *made.speeds()]:
        assert f"- **{column.heading}**: {column.meaning}" in text
    assert "recovered, unseen" in cells(text, "none", "default")
    assert "![](pictures.png)" in text


def test_nothing_has_run(make_matrix: MakeMatrix) -> None:
    assert "Not run yet" in page(results(make_matrix(), {}), pictures=False)


def test_the_files(make_matrix: MakeMatrix, outcome: MakeOutcome, tmp_path: Path) -> None:
    made = results(make_matrix(), {("none", "default"): [outcome(0.5), outcome(0.7)], ("some", "thesis"): ["no."]})
    folder = tmp_path / "runs" / "none-default-0"
    folder.mkdir(parents=True)
    strip = np.random.default_rng(0).integers(0, 255, (160, 1656, 3), dtype=np.uint8)
    Image.fromarray(strip).save(folder / "strip.png")
    placed = [
        replace(line, runs=tuple(replace(run, folder=tmp_path / "runs" / run.folder) for run in line.runs))
        for line in made.lines
    ]
    write_results(tmp_path / "noise", Results(made.matrix, tuple(placed)))
    record = json.loads((tmp_path / "noise" / "results.json").read_text())
    first = record["lines"][0]
    assert first["numbers"]["recovered"] == {"mean": 0.6, "deviation": np.std([0.5, 0.7], ddof=1), "count": 2, "of": 2}
    assert [run["seed"] for run in first["runs"]] == [0, 1]
    assert [line["runs"][0]["failed"] for line in record["lines"] if line["row"] == "some" and line["runs"]] == ["no."]
    with Image.open(tmp_path / "noise" / "pictures.png") as sheet:
        assert np.array_equal(np.asarray(sheet)[32 : 32 + 160, 280:], strip)
    assert (tmp_path / "noise" / "pictures" / "none-default.png").is_file()


def test_a_number_that_no_run_has(outcome: MakeOutcome) -> None:
    assert Column("x", "x", "x", lambda _: None).over([outcome()]) is None
