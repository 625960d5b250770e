"""Does an experiment: makes what is missing, and leaves a table, whatever stops it or fails."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.processes import Execute, execute, gpus
from svbrdfgan.experiments.provenance import keep_definition
from svbrdfgan.experiments.results import FAILED, Results, gather
from svbrdfgan.experiments.run_matrix import Cell, DatasetSpec, Design, OracleSpec, RunSpec, choose
from svbrdfgan.experiments.run_store import Shelf
from svbrdfgan.experiments.schedule import Schedule
from svbrdfgan.experiments.table import write_results
from svbrdfgan.experiments.tasks import DatasetTask, OracleTask, RunTask, Task
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.processes import cores


@dataclass(frozen=True)
class _Work:
    """The tasks of one cell; each needs those before it."""

    dataset: DatasetTask
    oracle: OracleTask
    run: RunTask


def run_experiments(
    designs: Sequence[Design],
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
    """Makes the data sets, oracles and runs that are missing, and writes the results of each design into `root/NAME`.

    Data sets, oracles and runs lie in `root` itself, where equal ones are shared.

    Args:
        assets: what file patterns are relative to.
        jobs: processes at once, spread over the GPUs.
        only: patterns of EXPERIMENT/ROW/RECIPE/SEED; runs that match, in this order.
        seeds: instead of those that the rows name.
        minutes: so long; what is not done by then is left as it is, and goes on another time.
        execute: does the tasks.

    Raises:
        ConfigError: a configuration is wrong, files are wanted but no assets given, or `root/NAME` holds the results of
            another definition.
    """
    until = time.monotonic() + 60 * minutes
    cells = choose([cell for design in designs for cell in design.cells(seeds)], only)
    _require_assets(cells, assets)
    for design in designs:
        keep_definition(design, root)
    runs = Shelf(root / "runs", RunSpec)
    work = [each for each in _work(cells, root, runs, assets or Path(), jobs) if not each.run.done()]
    schedule = Schedule(_missing(work, jobs))
    results = [_report(design, root, runs) for design in designs]
    shown = display or SilentDisplay()
    shown.begin("data sets, oracles and runs", len(schedule))
    with closing(execute(schedule, jobs, until, shown)) as ended:
        for task, reason in ended:
            shown.advance(1, task.title if reason is None else f"{task.title} FAILED")
            _note(task.path / FAILED, reason)
            results = [_report(design, root, runs) for design in designs]
    return results


def _work(cells: Sequence[Cell], root: Path, runs: Shelf[RunSpec], assets: Path, jobs: int) -> Iterator[_Work]:
    datasets, oracles = Shelf(root / "datasets", DatasetSpec), Shelf(root / "oracles", OracleSpec)
    where: dict[str, Any] = {"root": str(root), "assets": str(assets)}
    sharing = math.ceil(jobs / max(1, len(gpus())))
    for cell in cells:
        spec, name = cell.spec, f"{cell.experiment}-{cell.row}"
        dataset = datasets.place(DatasetSpec(dataset=spec.dataset), name).relative_to(root).as_posix()
        oracle = oracles.place(spec.oracle, f"{name}-{cell.recipe}").relative_to(root).as_posix()
        run = runs.place(spec, f"{name}-{cell.recipe}-{cell.seed}").relative_to(root).as_posix()
        yield _Work(
            DatasetTask(**where, title=f"data of {cell.row}", folder=dataset, config=spec.dataset, workers=1),
            OracleTask(
                **where, title=f"oracle of {cell.row}, {cell.recipe}", folder=oracle, spec=spec.oracle, dataset=dataset
            ),
            RunTask(**where, title=cell.title, folder=run, spec=spec, dataset=dataset, oracle=oracle, jobs=sharing),
        )


def _missing(work: Iterable[_Work], jobs: int) -> list[Task]:
    """What is not done, each once, in the order in which runs are wanted; data sets share the cores among them."""
    tasks: dict[str, Task] = {task.folder: task for each in work for task in (each.dataset, each.oracle, each.run)}
    missing = [task for task in tasks.values() if not task.done()]
    datasets = sum(isinstance(task, DatasetTask) for task in missing)
    workers = max(1, cores() // max(1, min(jobs, datasets)))
    return [t.model_copy(update={"workers": workers}) if isinstance(t, DatasetTask) else t for t in missing]


def _report(design: Design, root: Path, runs: Shelf[RunSpec]) -> Results:
    results = gather(design, runs)
    write_results(root / design.name, results)
    return results


def _note(path: Path, reason: str | None) -> None:
    """Keeps why a task failed; forgets it when it no longer does."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if reason is None:
        path.unlink(missing_ok=True)
    else:
        path.write_text(reason + "\n", encoding="utf-8")


def _require_assets(cells: Iterable[Cell], assets: Path | None) -> None:
    patterns = [pattern for cell in cells for pattern in cell.spec.files]
    if patterns and assets is None:
        raise ConfigError(f"files are wanted, such as {patterns[0]}; give --assets, the folder that they are in.")
