"""Does an experiment: makes what is missing, and leaves a table, whatever stops it or fails."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from svbrdfgan.display import Display, Silent
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.declared import keep_definition
from svbrdfgan.experiments.design import Cell, DatasetSpec, Design, OracleSpec, RunSpec
from svbrdfgan.experiments.processes import Execute, execute
from svbrdfgan.experiments.results import FAILED, Results, gather
from svbrdfgan.experiments.shelf import Shelf
from svbrdfgan.experiments.table import write_results
from svbrdfgan.experiments.tasks import DatasetTask, OracleTask, RunTask, Task
from svbrdfgan.processes import cores

AnyTask = TypeVar("AnyTask", DatasetTask, OracleTask, RunTask)


@dataclass(frozen=True)
class _Work:
    """The tasks of one cell; each needs those before it."""

    dataset: DatasetTask
    oracle: OracleTask
    run: RunTask


def run_experiment(
    design: Design,
    root: Path,
    *,
    assets: Path | None = None,
    jobs: int = 1,
    rows: Collection[str] = (),
    seeds: Collection[int] = (),
    display: Display | None = None,
    execute: Execute = execute,
) -> Results:
    """Makes the data sets, oracles and runs that are missing, and writes the results into `root/NAME`.

    Data sets, oracles and runs lie in `root` itself, where other experiments find them.

    Args:
        assets: what file patterns are relative to.
        jobs: processes at once.
        rows: these alone, if any are given.
        seeds: instead of those that the rows name.
        execute: does the tasks.

    Raises:
        ConfigError: a configuration is wrong, files are wanted but no assets given, or `root/NAME` holds the results of
            another definition.
    """
    cells = design.cells(rows, seeds)
    _require_assets(cells, assets)
    keep_definition(design, root)
    runs = Shelf(root / "runs", RunSpec)
    work = list(_work(design, cells, root, runs, assets or Path(), jobs))
    pending = [each for each in work if not each.run.done()]
    stages: dict[str, Sequence[Task]] = {
        "data sets": _missing(each.dataset for each in pending),
        "oracles": _missing(each.oracle for each in pending),
        "runs": _missing(each.run for each in pending),
    }
    shown = display or Silent()
    failures: dict[str, str] = {}
    results = _report(design, root, runs)
    for what, tasks in stages.items():
        if not tasks:
            continue
        shown.begin(what, len(tasks))
        with closing(_attempt(tasks, failures, jobs, shown, execute)) as attempts:
            for task, reason in attempts:
                shown.advance(1, task.title if reason is None else f"{task.title} FAILED")
                _note(task.path / FAILED, reason)
                if reason is not None:
                    failures[task.folder] = f"{task.title}: {reason}"
                results = _report(design, root, runs)
    return results


def _attempt(
    tasks: Sequence[Task], failures: dict[str, str], jobs: int, display: Display, execute: Execute
) -> Generator[tuple[Task, str | None], None, None]:
    """Does those whose needs were met; the others fail for the same reason as what they need."""
    blocked = {task.folder: failures[need] for task in tasks for need in _needs(task) if need in failures}
    yield from ((task, blocked[task.folder]) for task in tasks if task.folder in blocked)
    yield from execute([task for task in tasks if task.folder not in blocked], jobs, display)


def _needs(task: Task) -> tuple[str, ...]:
    match task:
        case RunTask():
            return (task.dataset, task.oracle)
        case OracleTask():
            return (task.dataset,)
        case DatasetTask():
            return ()


def _work(
    design: Design, cells: Sequence[Cell], root: Path, runs: Shelf[RunSpec], assets: Path, jobs: int
) -> Iterable[_Work]:
    datasets, oracles = Shelf(root / "datasets", DatasetSpec), Shelf(root / "oracles", OracleSpec)
    where: dict[str, Any] = {"root": str(root), "assets": str(assets)}
    workers = max(1, cores() // jobs)
    for cell in cells:
        spec, name = cell.spec, f"{design.name}-{cell.row}"
        dataset = datasets.place(DatasetSpec(dataset=spec.dataset), name).relative_to(root).as_posix()
        oracle = oracles.place(spec.oracle, f"{name}-{cell.recipe}").relative_to(root).as_posix()
        run = runs.place(spec, f"{name}-{cell.recipe}-{cell.seed}").relative_to(root).as_posix()
        yield _Work(
            DatasetTask(**where, title=f"data of {cell.row}", folder=dataset, config=spec.dataset, workers=workers),
            OracleTask(
                **where, title=f"oracle of {cell.row}, {cell.recipe}", folder=oracle, spec=spec.oracle, dataset=dataset
            ),
            RunTask(**where, title=cell.title, folder=run, spec=spec, dataset=dataset, oracle=oracle, jobs=jobs),
        )


def _missing(tasks: Iterable[AnyTask]) -> list[AnyTask]:
    """Each once, without those that are done."""
    first: dict[str, AnyTask] = {}
    for task in tasks:
        first.setdefault(task.folder, task)
    return [task for task in first.values() if not task.done()]


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
