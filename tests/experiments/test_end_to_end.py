"""A shipped experiment in the cpu profile, made small: from nothing to a table."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from svbrdfgan.experiments.outcome import RunOutcome
from svbrdfgan.experiments.processes import execute
from svbrdfgan.experiments.run_matrix import RunMatrix
from svbrdfgan.experiments.runner import run_experiments
from svbrdfgan.training.run import load_model
from svbrdfgan.utils.display import SilentDisplay

SMALL = (
    *("dataset.image=[32, 32]", "dataset.texture=32", "dataset.spp=8", "dataset.environment_rows=16"),
    *(
        f"dataset.splits.{split}.meshes.procedural.count={count}"
        for split, count in {"train": 6, "validation": 2, "test": 2}.items()
    ),
    *(
        "train.minutes=0.1",
        "train.spp=8",
        "train.generator.width=8",
        "train.discriminator.width=8",
        "train.score_every=5",
    ),
)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_an_experiment_from_nothing_to_a_table(tmp_path: Path) -> None:
    matrix = RunMatrix.load("training", "cpu", SMALL)
    matrix = replace(matrix, profile=matrix.profile.model_copy(update={"oracle_steps": 100}))
    (results,) = run_experiments([matrix], tmp_path, only=["training/matched"], jobs=2)
    assert results.failures == []
    assert [(line.row, line.recipe) for line in results.lines if line.outcomes] == [
        ("matched", "default"),
        ("matched", "thesis"),
    ]
    for outcome in results.outcomes:
        assert 6 <= outcome.seconds < 60
        assert outcome.evaluation.split == "test"
        assert math.isfinite(outcome.evaluation.generated.recovered)
        assert outcome.evaluation.oracle.steps == 100
        assert "unseen" in outcome.measures
    folder = tmp_path / "training"
    assert "| matched | thesis | 1 |" in (folder / "table.md").read_text()
    assert (folder / "pictures.png").is_file()
    record = json.loads((folder / "results.json").read_text())
    thesis = record["lines"][1]["runs"][0]["outcome"]
    assert thesis["history"][0]["images"] == 5 * 5  # five steps of five critic updates of one exemplar
    run = tmp_path / "runs" / record["lines"][0]["runs"][0]["folder"]
    assert load_model(run).config.train.recipe == "default"
    assert (run / "report.html").is_file()
    assert not (run / "checkpoints").exists()

    def forbidden(schedule, jobs, until, display):  # type: ignore[no-untyped-def]
        assert len(schedule) == 0
        yield from ()

    (again,) = run_experiments([matrix], tmp_path, only=["*/matched"], execute=forbidden)
    assert again.record() == results.record()
    (run / "outcome.json").unlink()  # as if stopped before the verdict was written
    before = RunOutcome.load(tmp_path / "runs" / record["lines"][1]["runs"][0]["folder"])
    done = []

    def watched(schedule, jobs, until, display):  # type: ignore[no-untyped-def]
        for task, reason in execute(schedule, jobs, until, SilentDisplay()):
            done.append(task.title)
            yield task, reason

    (resumed,) = run_experiments([matrix], tmp_path, only=["*/matched"], execute=watched)
    assert done == ["matched, default, seed 0"]
    assert resumed.failures == []
    assert resumed.outcomes[1] == before


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_distribution_from_nothing_to_a_table(tmp_path: Path) -> None:
    matrix = RunMatrix.load("variety", "cpu", (*SMALL, "train.steps=6"))
    (results,) = run_experiments([matrix], tmp_path, only=["variety/both"])
    assert results.failures == []
    (outcome,) = results.outcomes
    evaluation = outcome.evaluation
    assert evaluation.oracle.plateau is None
    assert evaluation.oracle.steps == 6
    assert evaluation.oracle.draws is not None
    assert evaluation.generated.figures.amount is not None
    assert evaluation.truth.figures is not None
    assert "resemblance of the oracle" in (tmp_path / "variety" / "table.md").read_text()
