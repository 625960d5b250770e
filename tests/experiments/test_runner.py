"""The harness: what is shared, what goes on, what fails alone, and what is refused."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.results import Results
from svbrdfgan.experiments.run_matrix import RunMatrix
from svbrdfgan.experiments.runner import run_experiments
from svbrdfgan.experiments.tasks import DatasetTask, OracleTask, RunTask

MakeMatrix = Callable[..., RunMatrix]


def run(matrix: RunMatrix, root: Path, **settings: Any) -> Results:
    (results,) = run_experiments([matrix], root, **settings)
    return results


def kinds(fake) -> list[type]:
    return [type(task) for task in fake.tasks]


def runs_of(fake) -> list[RunTask]:
    return [task for task in fake.tasks if isinstance(task, RunTask)]


def test_data_sets_and_oracles_are_shared(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    results = run(make_matrix(), tmp_path / "out", execute=fake)
    assert Counter(kinds(fake)) == {DatasetTask: 2, OracleTask: 3, RunTask: 7}
    runs = {task.title: task for task in runs_of(fake)}
    assert runs["none, default, seed 0"].dataset == runs["some, thesis, seed 0"].dataset
    assert runs["none, default, seed 0"].dataset != runs["fewer, default, seed 0"].dataset
    assert runs["none, default, seed 0"].oracle == runs["some, default, seed 1"].oracle
    assert runs["none, default, seed 0"].oracle != runs["none, thesis, seed 0"].oracle
    assert len({task.folder for task in runs.values()}) == 7
    assert [len(line.outcomes) for line in results.lines] == [2, 1, 2, 1, 1]


def test_an_experiment_without_oracles(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    results = run(make_matrix(oracles=False), tmp_path / "out", execute=fake)
    assert Counter(kinds(fake)) == {DatasetTask: 2, RunTask: 7}
    assert {task.oracle for task in runs_of(fake)} == {None}
    columns = {column.key for column in (*results.verdicts(), *results.speeds())}
    assert not columns & {"oracle", "fraction", "half_images", "half_seconds"}
    assert "oracle" not in (tmp_path / "out" / "noise" / "table.md").read_text()


def test_what_was_interrupted_goes_on(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    fake.stops_after = 8
    with pytest.raises(KeyboardInterrupt):
        run(make_matrix(), tmp_path / "out", execute=fake)
    output = (tmp_path / "out" / "noise" / "table.md").read_text()  # what there was until then
    assert "| none | default | 2 |" in output
    before, fake.stops_after = len(fake.done), None
    run(make_matrix(), tmp_path / "out", execute=fake)
    assert fake.done[before:] == [
        "some, thesis, seed 0", "data of fewer", "oracle of fewer, default", "fewer, default, seed 0",
    ]  # fmt: skip
    before = len(fake.done)
    results = run(make_matrix(), tmp_path / "out", execute=fake)
    assert fake.done[before:] == []
    assert len(results.outcomes) == 7


def test_finished_runs_need_no_data(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    """Outcomes alone may be carried elsewhere, and the experiment goes on from there."""
    run(make_matrix(), tmp_path / "out", only=["*/none"], execute=fake)
    for task in fake.tasks:
        if isinstance(task, DatasetTask):
            (task.path / "made").unlink()
    before = len(fake.done)
    run(make_matrix(), tmp_path / "out", only=["*/none"], execute=fake)
    assert fake.done[before:] == []
    run(make_matrix(), tmp_path / "out", only=["*/none", "*/fewer"], execute=fake)
    assert fake.done[before:] == ["data of fewer", "oracle of fewer, default", "fewer, default, seed 0"]


def test_a_failed_run_stops_no_other_and_is_tried_again(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    fake.fails = {"none, default, seed 1": "a loss is not finite."}
    results = run(make_matrix(), tmp_path / "out", execute=fake)
    assert [(line.row, run.seed, run.reason) for line, run in results.failures] == [
        ("none", 1, "a loss is not finite.")
    ]
    assert len(results.outcomes) == 6
    assert "none, default, seed 1: failed: a loss is not finite." in (tmp_path / "out/noise/table.md").read_text()
    fake.fails, before = {}, len(fake.done)
    results = run(make_matrix(), tmp_path / "out", execute=fake)
    assert fake.done[before:] == ["none, default, seed 1"]
    assert results.failures == []
    assert len(results.outcomes) == 7


def test_what_needs_a_failed_data_set_fails_with_its_reason(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    fake.fails = {"data of fewer": "car.glb has no faces."}
    results = run(make_matrix(), tmp_path / "out", execute=fake)
    assert "oracle of fewer, default" not in fake.done
    assert "fewer, default, seed 0" not in fake.done
    ((line, failed),) = results.failures
    assert line.row == "fewer"
    assert failed.reason == "oracle of fewer, default: data of fewer: car.glb has no faces."
    assert len(results.outcomes) == 6


def test_a_changed_definition_is_refused(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", only=["*/none"], execute=fake)
    before = len(fake.done)
    for changed in (make_matrix("train.spp=5"), make_matrix(train={"batch_size": 3})):
        with pytest.raises(ConfigError, match=r"holds results of another definition \(rows\.\w+/\w+\.") as caught:
            run(changed, tmp_path / "out", execute=fake)
        assert len(str(caught.value).splitlines()) == 1
    rows = {"none": {"about": "Said in other words."}}
    with pytest.raises(ConfigError, match="another definition"):  # rows that are gone
        run(make_matrix(rows=rows), tmp_path / "out", execute=fake)
    assert len(fake.done) == before
    assert "| none |" in (tmp_path / "out" / "noise" / "table.md").read_text()


def test_other_words_are_no_other_definition(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", only=["*/none"], execute=fake)
    run(make_matrix(title="Noise, once more"), tmp_path / "out", only=["*/none"], execute=fake)
    assert (tmp_path / "out" / "noise" / "table.md").read_text().startswith("# Noise, once more\n")


def test_experiments_share_equal_runs(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", only=["*/none"], execute=fake)
    before = len(fake.done)
    other = make_matrix(name="other", rows={"same": {"about": "."}, "spp": {"about": ".", "train": {"spp": 8}}})
    results = run(other, tmp_path / "out", seeds=[0], execute=fake)
    assert fake.done[before:] == ["spp, default, seed 0", "spp, thesis, seed 0"]
    assert [len(line.outcomes) for line in results.lines] == [2, 1, 1, 1]  # also what was made with another seed


def test_further_seeds_join_the_table(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", only=["*/fewer"], execute=fake)
    results = run(make_matrix(), tmp_path / "out", only=["*/fewer"], seeds=[4, 9], execute=fake)
    assert [run.seed for line in results.lines for run in line.runs] == [0, 4, 9]
    assert "| fewer | default | 3 |" in (tmp_path / "out" / "noise" / "table.md").read_text()


def test_files_need_assets(fake, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"files are needed, such as cars/.*; give --assets"):
        run(RunMatrix.load("training", "gpu"), tmp_path / "out", execute=fake)
    assert not (tmp_path / "out").exists()
    run(RunMatrix.load("training", "gpu"), tmp_path / "out", assets=tmp_path, only=["*/matched"], execute=fake)
    assert {task.assets for task in fake.tasks} == {str(tmp_path)}


def test_every_outcome_is_in_the_record(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", jobs=3, execute=fake)
    record = json.loads((tmp_path / "out" / "noise" / "results.json").read_text())
    assert {run["outcome"]["jobs"] for line in record["lines"] for run in line["runs"]} == {3}
    assert record["lines"][0]["numbers"]["recovered"]["mean"] == pytest.approx(0.55)


def test_chosen_runs_come_first_and_alone(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", only=["noise/some/default/1", "*/none/thesis"], execute=fake)
    assert [task.title for task in runs_of(fake)] == ["some, default, seed 1", "none, thesis, seed 0"]
    with pytest.raises(ConfigError, match=r"no run matches 'noise/nine'; did you mean 'noise/none'\?"):
        run(make_matrix(), tmp_path / "out", only=["noise/nine"], execute=fake)


def test_experiments_done_together_share_and_each_has_its_table(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    rows = {"same": {"about": "."}, "spp": {"about": ".", "train": {"spp": 8}}}
    matrices = [make_matrix(), make_matrix(name="other", rows=rows)]
    first, second = run_experiments(matrices, tmp_path / "out", only=["noise/none", "other"], execute=fake)
    assert Counter(kinds(fake)) == {DatasetTask: 1, OracleTask: 2, RunTask: 6}
    assert [len(line.outcomes) for line in (*first.lines, *second.lines)] == [2, 1, 0, 0, 0, 2, 1, 2, 1]
    assert "| spp | thesis | 1 |" in (tmp_path / "out" / "other" / "table.md").read_text()


def test_without_time_there_is_a_table_of_what_was_done(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    run(make_matrix(), tmp_path / "out", only=["*/none"], execute=fake)
    before, table = len(fake.done), tmp_path / "out" / "noise" / "table.md"
    output = table.read_text()
    table.unlink()
    results = run(make_matrix(), tmp_path / "out", minutes=0, execute=fake)
    assert len(fake.done) == before
    assert len(results.outcomes) == 3
    assert table.read_text() == output


def test_what_was_carried_is_enough(make_matrix: MakeMatrix, fake, tmp_path: Path) -> None:
    """Outcomes and ceilings are small; with them, only data sets of what is missing are made again."""
    run(make_matrix(), tmp_path / "out", only=["*/none/default/0"], execute=fake)
    for path in (tmp_path / "out").rglob("*.json"):
        if path.name in {"spec.json", "outcome.json", "ceiling.json", "definition.json"}:
            there = tmp_path / "new" / path.relative_to(tmp_path / "out")
            there.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, there)
    before = len(fake.done)
    results = run(make_matrix(), tmp_path / "new", only=["*/none/default"], execute=fake)
    assert fake.done[before:] == ["data of none", "none, default, seed 1"]
    assert len(results.outcomes) == 2
