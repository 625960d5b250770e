"""Sheets of draws: a picture for each seed, amount and recipe, and none for a generator of one layer."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from svbrdfgan.data import true_draws
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.evaluation.record import OracleScores
from svbrdfgan.metrics.resemblance import PART_MEANINGS, Resemblance
from svbrdfgan.networks.generator import Generator
from svbrdfgan.report.curves import charts
from svbrdfgan.report.draw_facts import draw_verdict, part_bars
from svbrdfgan.report.draws import COLUMNS, STRIP, sheets, strip
from svbrdfgan.report.page import write_report


@pytest.fixture(scope="module")
def varied(varied_run: Path) -> Evaluated:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(true_draws, "_POINTS", 128)
        return evaluate(varied_run, split="validation", device="cpu", oracle=False)


def test_a_sheet_shows_seeds_amounts_and_recipes(varied: Evaluated) -> None:
    (sheet,) = sheets(varied, [0])
    titles = [picture.title for picture in sheet.pictures]
    assert titles[:COLUMNS] == ["Truth", *(f"Seed {seed}" for seed in range(COLUMNS - 1))]
    assert titles[COLUMNS : 2 * COLUMNS] == [f"Amount {step:.2f}" for step in np.linspace(0.2, 1.0, COLUMNS)]
    assert titles[2 * COLUMNS :] == ["rust", "dust"]
    shown = {picture.title: np.asarray(picture.picture) for picture in sheet.pictures}
    for one, other in (("Seed 0", "Seed 1"), ("Amount 0.20", "Amount 1.00"), ("rust", "dust")):
        assert (shown[one] != shown[other]).any()


def test_the_report_has_the_sheets(varied: Evaluated, varied_run: Path) -> None:
    page = write_report(varied_run, varied).read_text(encoding="utf-8")
    assert "<h2>Draws</h2>" in page
    assert "Amount 0.20" in page
    assert "<h2>Close-ups</h2>" in page


PARTS = {"patches": 0.9, "mean": 1.1, "deviation": -0.2, "spectrum": 0.8, "joint": 0.7, "amount": 0.6}


def scored(varied: Evaluated, refusal: str = "") -> Evaluated:
    """The run with these parts, whatever it reached; or without draws that could be compared."""
    draws = None if refusal else Resemblance(**PARTS, subjects=3, draws=16)
    generated = varied.evaluation.generated.model_copy(update={"draws": draws})
    return replace(varied, evaluation=varied.evaluation.model_copy(update={"generated": generated, "refusal": refusal}))


def test_the_page_of_a_distribution_tells_of_draws_and_of_nothing_else(varied: Evaluated, varied_run: Path) -> None:
    page = write_report(varied_run, scored(varied)).read_text(encoding="utf-8")
    labels = re.findall(r'class="label">([^<]+)<', page)
    assert labels == ["resemblance", "least part: deviation", "deviation over draws", "relit FLIP, of true draws&#39;",
                      "amount, rank", "amount, error", "area seen"]  # fmt: skip
    assert "): resemblance 0.000</title>" in page
    shown = re.sub(r"data:[^\"]*", "", page)  # pictures in base64 spell any short word by chance
    body = shown[shown.index("<body>") : shown.index("<h2>Reproduce")]
    for said in ("recovered", "FLIP between", "Relit FLIP", "Best constant", "Error of", "no score was kept"):
        assert said not in body
    assert all(meaning in page for meaning in PART_MEANINGS.values())


def test_relief_is_shown_where_layers_have_normals(varied: Evaluated) -> None:
    found = varied.evaluation.generated
    figures = found.figures.model_copy(update={"relief": (0.61, 1.32, 0.94)})
    tilted = varied.evaluation.model_copy(update={"generated": found.model_copy(update={"figures": figures})})
    assert [figure.value for figure in draw_verdict(tilted) if figure.label.startswith("relief")] == ["0.61, 1.32"]


def test_a_distribution_whose_draws_could_not_be_compared_says_why(varied: Evaluated, varied_run: Path) -> None:
    page = write_report(varied_run, scored(varied, "they are too small.")).read_text(encoding="utf-8")
    assert "The draws have no score, since they are too small." in page
    assert "recovered" not in page[page.index("<body>") : page.index("<h2>Reproduce")]


def test_bars_of_parts_are_from_0_to_1_with_the_oracle_beside(varied: Evaluated) -> None:
    found = scored(varied).evaluation
    assert {bar.label: bar.percent for bar in part_bars(found)} == pytest.approx(
        {name: 100 * min(max(value, 0), 1) for name, value in PARTS.items()}
    )
    assert {bar.oracle for bar in part_bars(found)} == {None}
    best = found.generated.draws.model_copy(update={"deviation": 0.5, "mean": 0.0})
    oracle = OracleScores(recovered=0.1, flip=0.1, steps=4000, draws=best)
    beside = found.model_copy(update={"oracle": oracle})
    assert [bar.oracle for bar in part_bars(beside)] == pytest.approx([90, 0, 50, 80, 70, 60])
    (told,) = [figure for figure in draw_verdict(beside) if figure.label == "resemblance of the oracle"]
    assert "after 4,000 steps on true layers" in told.meaning


def test_a_strip_has_true_draws_above_draws_of_the_same_amounts(varied: Evaluated) -> None:
    """The one vehicle has two exemplars, so that half of the true draws are new ones."""
    pictures = strip(varied, 0).pictures
    above, below = pictures[:STRIP], pictures[STRIP:]
    assert len(below) == STRIP
    assert [each.note for each in above] == [each.note for each in below]
    assert [each.note for each in above] == [above[0].note] * 2 + [above[-1].note] * 2
    assert len({np.asarray(each.picture).tobytes() for each in pictures}) == 2 * STRIP


def test_training_of_a_distribution_has_a_curve_of_draws_and_none_of_single_layers(varied: Evaluated) -> None:
    log = [{"step": 2, "recovered": 0.3, "g_loss": 1.0}]
    assert [chart.title for chart in charts(log, varied.evaluation, varied.config.train)] == ["Losses"]
    log = [{"step": 2, "resemblance": 0.3}, {"step": 4, "resemblance": 0.5}, {"step": 6, "resemblance": 0.4}]
    (chart,) = charts(log, varied.evaluation, varied.config.train)
    assert (chart.title, list(chart.curves[0].y)) == ("Resemblance", [0.3, 0.5, 0.4])
    (level,) = chart.levels
    assert level.x == chart.curves[0].x[1], "the best was kept"


def test_close_ups_show_the_truth_and_the_same_place_as_learned(varied: Evaluated) -> None:
    (found,) = varied.close_ups
    assert set(found.pictures) == {"truth", "generated"}
    assert found.coverage.mean() > 0.5, "it is near"
    assert found.flips()["truth"] < found.flips()["generated"]


def test_a_generator_of_one_layer_has_none(varied: Evaluated) -> None:
    assert sheets(replace(varied, generator=Generator(width=4, blocks=0)), [0]) == []
    assert sheets(replace(varied, generator=None), [0]) == []
