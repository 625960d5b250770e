"""The tasks of experiments: making a data set, training its oracle, training and evaluating a run."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import torch
from pydantic import Field, TypeAdapter

from svbrdfgan.data.config import DatasetConfig, EnvironmentSource
from svbrdfgan.data.generate import generate, missing
from svbrdfgan.data.index import INDEX, DatasetIndex
from svbrdfgan.evaluation.adversarial_oracle import Budget
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import OracleScores
from svbrdfgan.experiments.contact_strip import CONTACT_STRIP, write_contact_strip
from svbrdfgan.experiments.outcome import OUTCOME, RunOutcome, ScorePoint
from svbrdfgan.experiments.processes import Task
from svbrdfgan.experiments.run_matrix import OracleSpec, RunSpec
from svbrdfgan.experiments.run_metrics import measure
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.report.page import write_report
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.run import CONFIG, ORACLE, ORACLE_NOTES
from svbrdfgan.training.state import State
from svbrdfgan.training.trainer import train
from svbrdfgan.utils.processes import cores

CEILING = "ceiling.json"
"""The scores of an oracle, for evaluating runs if its weights are missing."""


class DatasetTask(Task):
    """A data set; `workers` processes unwrap and bake meshes."""

    kind: Literal["dataset"] = "dataset"
    config: DatasetConfig
    workers: int

    def done(self) -> bool:
        return (self.path / INDEX).is_file() and next(missing(DatasetIndex.load(self.path), self.path), None) is None

    def work(self) -> None:
        generate(self.config, self.path, base=Path(self.assets), workers=self.workers)


class OracleTask(Task):
    """The oracle of a data set and a generator, made by evaluating a run of one step."""

    kind: Literal["oracle"] = "oracle"
    spec: OracleSpec
    dataset: str

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.dataset,)

    def done(self) -> bool:
        return (self.path / CEILING).is_file()

    def work(self) -> None:
        _train(self, self.spec.train, self.dataset)
        schedule = OracleConfig(batch=self.spec.train.batch_size, steps=self.spec.steps)
        budget = Budget(self.spec.steps, self.spec.minutes)
        evaluated = evaluate(self.path, split="test", schedule=schedule, budget=budget)
        assert evaluated.evaluation.oracle is not None
        save_record(self.path / CEILING, evaluated.evaluation.oracle)
        _forget_checkpoints(self.path)


class RunTask(Task):
    """A run, and its evaluation beside the oracle if there is one; `jobs` runs share the device."""

    kind: Literal["run"] = "run"
    spec: RunSpec
    dataset: str
    oracle: str | None
    jobs: int

    @property
    def needs(self) -> tuple[str, ...]:
        return (self.dataset,) if self.oracle is None else (self.dataset, self.oracle)

    def done(self) -> bool:
        return (self.path / OUTCOME).is_file()

    def work(self) -> None:
        state = _train(self, self.spec.train, self.dataset)
        evaluated = self._evaluate()
        write_report(self.path, evaluated)
        write_contact_strip(self.path / CONTACT_STRIP, evaluated)
        RunOutcome(
            evaluation=evaluated.evaluation,
            history=tuple(map(partial(_point, self.spec.train), state.history)),
            measures=measure(evaluated),
            device=torch.cuda.get_device_name() if torch.cuda.is_available() else "CPU",
            jobs=self.jobs,
            versions=evaluated.config.versions,
        ).save(self.path)
        _forget_checkpoints(self.path)

    def _evaluate(self) -> Evaluated:
        """Evaluates with the oracle if its weights exist; else with its scores, which may have been copied alone."""
        workers = max(1, cores() // self.jobs)
        if self.oracle is None:
            return evaluate(self.path, split="test", oracle=False, workers=workers)
        oracle = Path(self.root) / self.oracle
        ceiling = load_record(OracleScores, oracle / CEILING)
        if (oracle / ORACLE).is_file() and (oracle / ORACLE_NOTES).is_file():
            for name in (ORACLE, ORACLE_NOTES):
                shutil.copyfile(oracle / name, self.path / name)
            return evaluate(self.path, split="test", workers=workers)
        evaluated = evaluate(self.path, split="test", oracle=False, workers=workers)
        evaluation = evaluated.evaluation.model_copy(update={"oracle": ceiling})
        evaluation.save(self.path)
        return replace(evaluated, evaluation=evaluation)


_AnyTask = Annotated[DatasetTask | OracleTask | RunTask, Field(discriminator="kind")]

TASK: TypeAdapter[_AnyTask] = TypeAdapter(_AnyTask)
"""Reads and writes a task of any kind as JSON."""


def _train(task: OracleTask | RunTask, config: TrainConfig, dataset: str) -> State:
    """Trains a run, or continues it. Patterns of environment files are made absolute, from the assets folder."""
    scenes = config.scenes
    if isinstance(scenes.environment, EnvironmentSource):
        files = tuple(str(Path(task.assets).resolve() / pattern) for pattern in scenes.environment.files)
        scenes = scenes.model_copy(update={"environment": scenes.environment.model_copy(update={"files": files})})
    placed = config.model_copy(update={"dataset": dataset, "scenes": scenes})
    return train(placed, task.path, base=Path(task.root), resume=(task.path / CONFIG).is_file())


def _point(config: TrainConfig, entry: dict[str, float]) -> ScorePoint:
    images = round(entry["step"]) * config.images_per_step
    scores = {name: entry.get(name) for name in ("recovered", "resemblance")}
    return ScorePoint(images=images, seconds=entry["seconds"], **scores)


def _forget_checkpoints(run: Path) -> None:
    """Deletes the checkpoints of a complete run, which are several times as large as its model."""
    shutil.rmtree(run / "checkpoints", ignore_errors=True)
