"""Experiments without their cost: outcomes made up, and tasks that only leave the files of finished ones."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml

from svbrdfgan.evaluation.record import ConstantScores, Evaluation, LearnedScores, OracleScores, PainterScores
from svbrdfgan.experiments.outcome import RunOutcome, ScorePoint
from svbrdfgan.experiments.processes import Schedule, Task
from svbrdfgan.experiments.run_matrix import RunMatrix
from svbrdfgan.experiments.tasks import CEILING, DatasetTask, OracleTask, RunTask
from svbrdfgan.io.records import save_record
from svbrdfgan.utils.display import Display

EXPERIMENT: dict[str, Any] = {
    "title": "Noise",
    "figure": "figure 9-9",
    "thesis": "It hurts.",
    "recipes": {"default": [0, 1], "thesis": [0]},
    "rows": {
        "none": {"about": "No noise."},
        "some": {"about": "Some noise.", "train": {"scenes.camera_noise_degrees": 5}},
        "fewer": {"about": "Fewer views.", "dataset": {"splits.train.views": 2}, "recipes": {"default": [0]}},
    },
}

MakeOutcome = Callable[..., RunOutcome]


def make_outcome(
    recovered: float = 0.6,
    oracle: float = 0.8,
    history: Sequence[tuple[int, float, float]] = ((100, 10.0, 0.2), (200, 20.0, 0.5), (300, 30.0, 0.45)),
    jobs: int = 1,
    plateau: bool = True,
) -> RunOutcome:
    """An outcome; the history holds images, seconds and score."""
    evaluation = Evaluation(
        split="test",
        subjects=3,
        exemplars=6,
        areas={"base_color": 0.9},
        generated=LearnedScores(recovered=recovered, flip=0.1),
        oracle=OracleScores(recovered=oracle, flip=0.05, steps=300, plateau=plateau, validation=oracle),
        constant=ConstantScores(flip=0.2, layer=(0, 0, 0, 0)),
        truth=PainterScores(flip=0.02),
    )
    points = tuple(ScorePoint(images=i, seconds=s, recovered=r) for i, s, r in history)
    return RunOutcome(evaluation=evaluation, history=points, device="CPU", jobs=jobs, versions={})


@pytest.fixture
def outcome() -> MakeOutcome:
    return make_outcome


@pytest.fixture
def make_matrix(tmp_path: Path) -> Callable[..., RunMatrix]:
    """The experiment above, with keys of it replaced, in the cpu profile with both seeds."""

    def make(*overrides: str, name: str = "noise", **changes: Any) -> RunMatrix:
        path = tmp_path / f"{name}.yaml"
        path.write_text(yaml.safe_dump({**EXPERIMENT, **changes}, sort_keys=False), encoding="utf-8")
        matrix = RunMatrix.load(str(path), "cpu", overrides)
        profile = matrix.profile.model_copy(update={"seeds": 2})
        return RunMatrix(matrix.name, matrix.experiment, "cpu", profile, matrix.overrides)

    return make


@dataclass
class FakeExecute:
    """Does tasks by leaving the files of finished ones.

    Attributes:
        fails: reasons, by title of the task.
        stops_after: tasks; then it is interrupted.
        done: titles of what was done, by all calls.
    """

    fails: dict[str, str] = field(default_factory=dict)
    stops_after: int | None = None
    done: list[str] = field(default_factory=list)
    tasks: list[Task] = field(default_factory=list)

    def __call__(
        self, schedule: Schedule, jobs: int, until: float, display: Display
    ) -> Generator[tuple[Task, str | None], None, None]:
        while time.monotonic() < until and (task := schedule.take()) is not None:
            if self.stops_after == len(self.done):
                raise KeyboardInterrupt
            self.done.append(task.title)
            self.tasks.append(task)
            if task.title in self.fails:
                yield from schedule.end(task, self.fails[task.title])
                continue
            task.path.mkdir(parents=True, exist_ok=True)
            match task:
                case DatasetTask():
                    (task.path / "made").touch()
                case OracleTask():
                    save_record(task.path / CEILING, make_outcome().evaluation.oracle)
                case RunTask():
                    make_outcome(0.5 + 0.1 * task.spec.train.seed, jobs=jobs).save(task.path)
            yield from schedule.end(task, None)


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> FakeExecute:
    monkeypatch.setattr(DatasetTask, "done", lambda self: (self.path / "made").is_file())
    return FakeExecute()
