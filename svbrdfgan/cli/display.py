"""Progress on the terminal: a bar where it is one, a line now and then where it is not."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

_LINE_EVERY = 15.0


class TerminalDisplay:
    """Draws one bar at a time."""

    def __init__(self, console: Console, progress: Progress) -> None:
        self._console, self._progress = console, progress
        self._task: TaskID | None = None
        self._said = 0.0

    def begin(self, what: str, total: int | None = None) -> None:
        if self._task is not None:
            self._end()
        self._task = self._progress.add_task(what, total=total, note="")
        self._said = time.monotonic()
        if not self._console.is_terminal:
            self._console.print(f"{what} ...")

    def advance(self, steps: int = 1, note: str = "") -> None:
        if self._task is None:
            return
        self._progress.advance(self._task, steps)
        if note:
            self._progress.update(self._task, note=note)
        if not self._console.is_terminal and time.monotonic() - self._said > _LINE_EVERY:
            self._say()

    def _say(self) -> None:
        task = self._progress.tasks[-1]
        of = f" of {task.total:.0f}" if task.total else ""
        self._console.print(f"  {task.description}: {task.completed:.0f}{of} {task.fields['note']}".rstrip())
        self._said = time.monotonic()

    def _end(self) -> None:
        assert self._task is not None
        task = next(task for task in self._progress.tasks if task.id == self._task)
        if task.total is None:
            self._progress.update(self._task, total=max(task.completed, 1), completed=max(task.completed, 1))
        self._progress.stop_task(self._task)


@contextmanager
def terminal_display(console: Console) -> Iterator[TerminalDisplay]:
    """A display for the time of a job."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[note]}", style="cyan"),
    )
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        yield TerminalDisplay(console, progress)
