"""Runs experiments: executes the missing tasks, and writes the tables after every task that ends."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.processes import Execute, Schedule, Task, execute, gpus
from svbrdfgan.experiments.results import FAILED, Results, gather
from svbrdfgan.experiments.run_matrix import Cell, DatasetSpec, OracleSpec, RunMatrix, RunSpec, select_cells
from svbrdfgan.experiments.run_store import RunStore, record_provenance
from svbrdfgan.experiments.table import write_results
from svbrdfgan.experiments.tasks import DatasetTask, OracleTask, RunTask
from svbrdfgan.io.claims import claimed_folder
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.processes import cores


@dataclass(frozen=True)
class _Work:
    """The tasks of one cell; each needs the tasks before it."""

    dataset: DatasetTask
    oracle: OracleTask | None
    run: RunTask

    @property
    def tasks(self) -> list[DatasetTask | OracleTask | RunTask]:
        return [task for task in (self.dataset, self.oracle, self.run) if task is not None]


def run_experiments(
    matrices: Sequence[RunMatrix],
    root: Path,
    *,
    assets: Path | None = None,
    jobs: int = 1,
    only: Sequence[str] = (),
    seeds: Collection[int] = (),
    minutes: float = math.inf,
    display: Display | None = None,
    execute: Execute = execute,
) -> list[Results]:
    """Executes all missing tasks, and returns the results of each matrix, which are also written into `root/NAME`.

    Data sets, oracles and runs are stored below `root` itself, where matrices share equal ones.

    Args:
        assets: folder that file patterns are relative to.
        jobs: number of processes at once, spread over the GPUs.
        only: patterns of EXPERIMENT/ROW/RECIPE/SEED; only matching runs are made, in the order of the patterns.
        seeds: replace the seeds that the rows name.
        minutes: time limit; the next call continues tasks that are not complete by then.
        execute: function that runs the tasks.

    Raises:
        ConfigError: a configuration is wrong, files are needed but `assets` is None, or `root/NAME` holds results of
            another definition.
    """
    until = time.monotonic() + 60 * minutes
    cells = select_cells([cell for matrix in matrices for cell in matrix.cells(seeds)], only)
    _require_assets(cells, assets)
    with claimed_folder(root):
        for matrix in matrices:
            record_provenance(matrix, root)
        runs = RunStore(root / "runs", RunSpec)
        work = [each for each in _work(cells, root, runs, assets or Path(), jobs) if not each.run.done()]
        schedule = Schedule(_missing(work, jobs))
        results = [_report(matrix, root, runs) for matrix in matrices]
        display = display or SilentDisplay()
        display.begin("data sets, oracles and runs", len(schedule))
        with closing(execute(schedule, jobs, until, display)) as ended:
            for task, reason in ended:
                display.advance(1, task.title if reason is None else f"{task.title} FAILED")
                _note(task.path / FAILED, reason)
                results = [_report(matrix, root, runs) for matrix in matrices]
        return results


def _work(cells: Sequence[Cell], root: Path, runs: RunStore[RunSpec], assets: Path, jobs: int) -> Iterator[_Work]:
    datasets, oracles = RunStore(root / "datasets", DatasetSpec), RunStore(root / "oracles", OracleSpec)
    where: dict[str, Any] = {"root": str(root), "assets": str(assets)}
    # runs on one GPU, recorded because they slow each other
    sharing = math.ceil(jobs / max(1, len(gpus())))
    for cell in cells:
        spec, name = cell.spec, f"{cell.experiment}-{cell.row}"
        dataset = datasets.place(DatasetSpec(dataset=spec.dataset), name).relative_to(root).as_posix()
        beside = None
        if cell.oracle:
            oracle = oracles.place(spec.oracle, f"{name}-{cell.recipe}").relative_to(root).as_posix()
            title = f"oracle of {cell.row}, {cell.recipe}"
            beside = OracleTask(**where, title=title, folder=oracle, spec=spec.oracle, dataset=dataset)
        run = runs.place(spec, f"{name}-{cell.recipe}-{cell.seed}").relative_to(root).as_posix()
        yield _Work(
            DatasetTask(**where, title=f"data of {cell.row}", folder=dataset, config=spec.dataset, workers=1),
            beside,
            RunTask(
                **where,
                title=cell.title,
                folder=run,
                spec=spec,
                dataset=dataset,
                oracle=None if beside is None else beside.folder,
                jobs=sharing,
            ),
        )


def _missing(work: Iterable[_Work], jobs: int) -> list[Task]:
    """The tasks that are not done, each once, in the order of the runs. Data sets made at once share the cores."""
    tasks: dict[str, DatasetTask | OracleTask | RunTask] = {task.folder: task for each in work for task in each.tasks}
    missing = [task for task in tasks.values() if not task.done()]
    datasets = sum(isinstance(task, DatasetTask) for task in missing)
    workers = max(1, cores() // max(1, min(jobs, datasets)))
    return [t.model_copy(update={"workers": workers}) if isinstance(t, DatasetTask) else t for t in missing]


def _report(matrix: RunMatrix, root: Path, runs: RunStore[RunSpec]) -> Results:
    results = gather(matrix, runs)
    write_results(root / matrix.name, results)
    return results


def _note(path: Path, reason: str | None) -> None:
    """Writes the reason why a task failed; deletes the file if it succeeded."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if reason is None:
        path.unlink(missing_ok=True)
    else:
        path.write_text(reason + "\n", encoding="utf-8")


def _require_assets(cells: Iterable[Cell], assets: Path | None) -> None:
    patterns = [pattern for cell in cells for pattern in cell.spec.files]
    if patterns and assets is None:
        raise ConfigError(f"files are needed, such as {patterns[0]}; give --assets, the folder that holds them.")
