"""The results of an experiment so far: the outcomes on disk, by row and recipe."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.experiments.columns import OF_ORACLE, Column, speeds, verdicts
from svbrdfgan.experiments.definition import Recipe
from svbrdfgan.experiments.outcome import OUTCOME, RunOutcome
from svbrdfgan.experiments.run_matrix import RunMatrix, RunSpec
from svbrdfgan.experiments.run_store import RunStore

FORMAT = "svbrdfgan experiment 1"
FAILED = "failed.txt"


@dataclass(frozen=True)
class FinishedRun:
    """A run that ended, with its outcome or the reason why it failed."""

    seed: int
    folder: Path
    outcome: RunOutcome | None = None
    reason: str | None = None


@dataclass(frozen=True)
class TableLine:
    """A line of the table: a row of the experiment trained by one recipe, and its runs so far."""

    row: str
    recipe: Recipe
    runs: tuple[FinishedRun, ...]

    @property
    def outcomes(self) -> list[RunOutcome]:
        return [run.outcome for run in self.runs if run.outcome is not None]


@dataclass(frozen=True)
class Results:
    """All contents of the table."""

    matrix: RunMatrix
    lines: tuple[TableLine, ...]

    @property
    def outcomes(self) -> list[RunOutcome]:
        return [outcome for line in self.lines for outcome in line.outcomes]

    @property
    def failures(self) -> list[tuple[TableLine, FinishedRun]]:
        return [(line, run) for line in self.lines for run in line.runs if run.reason is not None]

    def verdicts(self) -> list[Column]:
        """The columns for the quality of the learned layers."""
        return self._known(verdicts(self.matrix.experiment.measures, self.outcomes))

    def speeds(self) -> list[Column]:
        """The columns for the speed of training, also within the largest budgets that all runs reached."""
        images = min((outcome.images for outcome in self.outcomes), default=0)
        return self._known(speeds(images, min((outcome.seconds for outcome in self.outcomes), default=0.0)))

    def _known(self, columns: list[Column]) -> list[Column]:
        return [column for column in columns if self.matrix.experiment.oracles or column.key not in OF_ORACLE]

    def record(self) -> dict[str, Any]:
        """The results as JSON values."""
        matrix, columns = self.matrix, [*self.verdicts(), *self.speeds()]
        return {
            "format": FORMAT,
            "experiment": matrix.name,
            "title": matrix.experiment.title,
            "profile": matrix.profile_name,
            "overrides": list(matrix.overrides),
            "columns": {column.key: {"heading": column.heading, "meaning": column.meaning} for column in columns},
            "lines": [
                {
                    "row": line.row,
                    "recipe": line.recipe,
                    "changes": matrix.changes(line.row),
                    "numbers": {column.key: _number(column, line) for column in columns},
                    "runs": [_run_record(run) for run in line.runs],
                }
                for line in self.lines
            ],
        }


def gather(matrix: RunMatrix, runs: RunStore[RunSpec]) -> Results:
    """All finished runs of the experiment, with any seed, including runs that other calls or experiments made."""
    seeds = sorted({spec.train.seed for spec in runs.specs.values()})
    lines = []
    for name, row in matrix.experiment.rows.items():
        for recipe in matrix.recipes(row):
            found = [(seed, runs.find(matrix.cell(name, recipe, seed).spec)) for seed in seeds]
            ended = [_ended(seed, folder) for seed, folder in found if folder is not None]
            lines.append(TableLine(name, recipe, tuple(run for run in ended if run is not None)))
    return Results(matrix, tuple(lines))


def _ended(seed: int, folder: Path) -> FinishedRun | None:
    if (folder / OUTCOME).is_file():
        return FinishedRun(seed, folder, outcome=RunOutcome.load(folder))
    if (folder / FAILED).is_file():
        return FinishedRun(seed, folder, reason=(folder / FAILED).read_text(encoding="utf-8").strip())
    return None


def _number(column: Column, line: TableLine) -> dict[str, Any] | None:
    statistic = column.over(line.outcomes)
    return None if statistic is None else asdict(statistic)


def _run_record(run: FinishedRun) -> dict[str, Any]:
    outcome = None if run.outcome is None else run.outcome.model_dump(mode="json")
    return {"seed": run.seed, "folder": run.folder.name, "failed": run.reason, "outcome": outcome}
