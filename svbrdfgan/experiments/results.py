"""What is known of an experiment: the outcomes on disk, by row and recipe."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.experiments.columns import Column, speeds, verdicts
from svbrdfgan.experiments.definition import Recipe
from svbrdfgan.experiments.outcome import OUTCOME, Outcome
from svbrdfgan.experiments.run_matrix import Design, RunSpec
from svbrdfgan.experiments.run_store import Shelf

FORMAT = "svbrdfgan experiment 1"
FAILED = "failed.txt"


@dataclass(frozen=True)
class Run:
    """One run that ended: with an outcome, or a reason for having failed."""

    seed: int
    folder: Path
    outcome: Outcome | None = None
    reason: str | None = None


@dataclass(frozen=True)
class Line:
    """A line of the table: a row by a recipe, and its runs so far."""

    row: str
    recipe: Recipe
    runs: tuple[Run, ...]

    @property
    def outcomes(self) -> list[Outcome]:
        return [run.outcome for run in self.runs if run.outcome is not None]


@dataclass(frozen=True)
class Results:
    """Everything that the table tells."""

    design: Design
    lines: tuple[Line, ...]

    @property
    def outcomes(self) -> list[Outcome]:
        return [outcome for line in self.lines for outcome in line.outcomes]

    @property
    def failures(self) -> list[tuple[Line, Run]]:
        return [(line, run) for line in self.lines for run in line.runs if run.reason is not None]

    def verdicts(self) -> list[Column]:
        """How well was learned."""
        return verdicts(self.design.experiment.measures)

    def speeds(self) -> list[Column]:
        """How fast, and at the largest budgets that all runs have in common."""
        images = min((outcome.images for outcome in self.outcomes), default=0)
        return speeds(images, min((outcome.seconds for outcome in self.outcomes), default=0.0))

    def record(self) -> dict[str, Any]:
        """As JSON values."""
        design, columns = self.design, [*self.verdicts(), *self.speeds()]
        return {
            "format": FORMAT,
            "experiment": design.name,
            "title": design.experiment.title,
            "profile": design.profile_name,
            "overrides": list(design.overrides),
            "columns": {column.key: {"heading": column.heading, "meaning": column.meaning} for column in columns},
            "lines": [
                {
                    "row": line.row,
                    "recipe": line.recipe,
                    "changes": design.changes(line.row),
                    "numbers": {column.key: _number(column, line) for column in columns},
                    "runs": [_run_record(run) for run in line.runs],
                }
                for line in self.lines
            ],
        }


def gather(design: Design, runs: Shelf[RunSpec]) -> Results:
    """The runs of the experiment that ended, whichever call or experiment made them, and with whatever seeds."""
    seeds = sorted({spec.train.seed for spec in runs.specs.values()})
    lines = []
    for name, row in design.experiment.rows.items():
        for recipe in design.recipes(row):
            found = [(seed, runs.find(design.cell(name, recipe, seed).spec)) for seed in seeds]
            ended = [_ended(seed, folder) for seed, folder in found if folder is not None]
            lines.append(Line(name, recipe, tuple(run for run in ended if run is not None)))
    return Results(design, tuple(lines))


def _ended(seed: int, folder: Path) -> Run | None:
    if (folder / OUTCOME).is_file():
        return Run(seed, folder, outcome=Outcome.load(folder))
    if (folder / FAILED).is_file():
        return Run(seed, folder, reason=(folder / FAILED).read_text(encoding="utf-8").strip())
    return None


def _number(column: Column, line: Line) -> dict[str, Any] | None:
    statistic = column.over(line.outcomes)
    return None if statistic is None else asdict(statistic)


def _run_record(run: Run) -> dict[str, Any]:
    outcome = None if run.outcome is None else run.outcome.model_dump(mode="json")
    return {"seed": run.seed, "folder": run.folder.name, "failed": run.reason, "outcome": outcome}
