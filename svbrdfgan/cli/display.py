"""Progress on stderr while commands work, and tables on stdout; both depend on whether that is a terminal."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING

import click
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

if TYPE_CHECKING:
    from rich.table import Table

_SILENCE_SECONDS = 9.0  # after which a line is printed: with the tick, less than the promised ten
_TICK_SECONDS = 0.5
_UNBOUNDED = 10_000
"""Columns of a console that is no terminal: wider than any table."""

_clock = time.monotonic


class ProgressBar:
    """One bar on a terminal at a time, with the time that has passed."""

    def __init__(self, progress: Progress, what: str) -> None:
        self._progress = progress
        self._task: TaskID | None = None
        self._is_stage = False
        self.stage(what)

    def stage(self, what: str) -> None:
        """Starts something without steps; its bar disappears when the next thing starts."""
        self._start(what, None, is_stage=True)

    def begin(self, what: str, total: int | None = None) -> None:
        self._start(what, total, is_stage=False)

    def advance(self, steps: int = 1, note: str = "") -> None:
        assert self._task is not None
        self._progress.advance(self._task, steps)
        if note:
            self._progress.update(self._task, note=note)

    def end(self) -> None:
        """Removes the bar of a stage; stops any other where it is."""
        if self._task is None:
            return
        if self._is_stage:
            self._progress.remove_task(self._task)
        else:
            task = next(task for task in self._progress.tasks if task.id == self._task)
            if task.total is None:
                steps = max(task.completed, 1)
                self._progress.update(self._task, total=steps, completed=steps)
            self._progress.stop_task(self._task)
        self._task = None

    def _start(self, what: str, total: int | None, *, is_stage: bool) -> None:
        self.end()
        self._task, self._is_stage = self._progress.add_task(what, total=total, note=""), is_stage


class ProgressLines:
    """Plain lines: one when something begins, and one whenever there was none for nine seconds."""

    def __init__(self, what: str) -> None:
        self._lock = Lock()
        self._what, self._began, self._last_line = what, _clock(), _clock()
        self._total: int | None = None
        self._done, self._note = 0, ""

    def stage(self, what: str) -> None:
        """Starts something without steps. No line says so unless it takes long: most stages take a second."""
        self._start(what, None)

    def begin(self, what: str, total: int | None = None) -> None:
        self._start(what, total)
        self._print(f"{what} ...")

    def advance(self, steps: int = 1, note: str = "") -> None:
        with self._lock:
            self._done += steps
            self._note = note or self._note

    def tick(self) -> None:
        """Prints how far things are, if nothing was printed for nine seconds."""
        with self._lock:
            now = _clock()
            if now - self._last_line < _SILENCE_SECONDS:
                return
            of = f"{self._done} of {self._total}, " if self._total else f"{self._done}, " if self._done else ""
            note = f", {self._note}" if self._note else ""
            line = f"  {self._what}: {of}{now - self._began:.0f} s{note}"
        self._print(line)

    def tick_until(self, over: Event) -> None:
        while not over.wait(_TICK_SECONDS):
            self.tick()

    def _start(self, what: str, total: int | None) -> None:
        with self._lock:
            self._what, self._total, self._done, self._note, self._began = what, total, 0, "", _clock()

    def _print(self, line: str) -> None:
        self._last_line = _clock()
        click.echo(line, err=True)


@contextmanager
def progress(what: str) -> Iterator[ProgressBar | ProgressLines]:
    """Says on stderr what is being done for the time of the block: `what` at first, then what is begun.

    On a terminal a bar is redrawn. Elsewhere, such as in a file or a program, plain lines come at intervals of less
    than ten seconds. Results are printed after the block.
    """
    console = Console(stderr=True)
    if sys.stderr.isatty() and not console.is_dumb_terminal:
        with _bars(console) as bars:
            bar = ProgressBar(bars, what)
            try:
                yield bar
            finally:
                bar.end()
        return
    lines, over = ProgressLines(what), Event()
    ticker = Thread(target=lines.tick_until, args=[over], daemon=True)
    ticker.start()
    try:
        yield lines
    finally:
        over.set()
        ticker.join()


def _bars(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(bar_width=24),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(compact=True),
        TextColumn("{task.fields[note]}", style="cyan", markup=False),
        console=console,
    )


def output_console() -> Console:
    """The console on stdout; if that is no terminal, without colours and wrapping, whatever COLUMNS says."""
    return Console() if sys.stdout.isatty() else Console(width=_UNBOUNDED, force_terminal=False, no_color=True)


def print_table(table: Table) -> None:
    """Prints a table on stdout: on a terminal as it is, elsewhere whole, in plain columns with two spaces between."""
    console = output_console()
    if console.is_terminal:
        console.print(table)
        return
    table.box, table.pad_edge = None, False
    title, caption = table.title, table.caption
    table.title = table.caption = None  # they would be wrapped to the table's width
    with console.capture() as captured:
        console.print(table)
    for line in (title, *captured.get().splitlines(), caption):
        if line is not None:
            click.echo(str(line).rstrip())
