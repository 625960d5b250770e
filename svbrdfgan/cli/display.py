"""Progress on stderr while commands work, and tables on stdout; both depend on whether that is a terminal."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Lock, Thread
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
)
from rich.segment import Segment, Segments
from rich.text import Text

from svbrdfgan.cli.pace import Pace, duration
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.printable import printable

if TYPE_CHECKING:
    from rich.table import Table

_FIRST_SECONDS = 2.0  # after which a phase's first line is printed: with the tick, less than the promised three
_SILENCE_SECONDS = 8.0  # and after which each further one is: less than the promised nine
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
        self._pace = Pace(None, _clock())
        self.stage(what)

    def stage(self, what: str, total: int | None = None) -> None:
        """Starts something whose bar disappears when the next thing starts."""
        self._start(what, total, is_stage=True)

    def begin(self, what: str, total: int | None = None, done: int = 0) -> None:
        self._start(what, total, done, is_stage=False)

    def advance(self, steps: int = 1, note: str = "") -> None:
        assert self._task is not None
        self._pace.advance(steps, _clock())
        self._progress.advance(self._task, steps)
        if note:
            self._progress.update(self._task, note=printable(note))

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

    def _start(self, what: str, total: int | None, done: int = 0, *, is_stage: bool) -> None:
        self.end()
        self._pace, self._is_stage = Pace(total, _clock(), done), is_stage
        self._task = self._progress.add_task(printable(what), total=total, completed=done, note="", pace=self._pace)


class _TimeLeftColumn(ProgressColumn):
    """The time left of a bar that is not stopped."""

    def render(self, task: Task) -> Text:
        pace: Pace = task.fields["pace"]
        return Text("" if task.stop_time is not None else pace.left(_clock()), style="progress.remaining")


class ProgressLines:
    """Plain lines: one when something begins, and one whenever there was none for nine seconds.

    Of a phase that lasts three seconds there is one by then.
    """

    def __init__(self, what: str) -> None:
        self._lock, self._silent_since = Lock(), _clock()
        self._note, self._is_told = "", False
        self._start(what, None)

    def stage(self, what: str, total: int | None = None) -> None:
        """Starts something of which no line says so unless it takes long: most stages take a second."""
        self._start(what, total)

    def begin(self, what: str, total: int | None = None, done: int = 0) -> None:
        self._start(what, total, done)
        self._silent_since = _clock()
        echo(f"{what} ...", err=True)

    def advance(self, steps: int = 1, note: str = "") -> None:
        with self._lock:
            self._pace.advance(steps, _clock())
            self._note = note or self._note

    def tick(self) -> None:
        """Prints how far things are, if it is time to."""
        with self._lock:
            now = _clock()
            first = not self._is_told and now - self._pace.began >= _FIRST_SECONDS
            if not first and now - self._silent_since < _SILENCE_SECONDS:
                return
            self._is_told, self._silent_since = True, now
            left = self._pace.left(now) or duration(now - self._pace.began)
            line = f"  {self._what}: {', '.join(filter(None, [self._pace.count(), left, self._note]))}"
        echo(line, err=True)

    def tick_until(self, over: Event) -> None:
        while not over.wait(_TICK_SECONDS):
            self.tick()

    def _start(self, what: str, total: int | None, done: int = 0) -> None:
        with self._lock:
            self._what, self._pace, self._note, self._is_told = what, Pace(total, _clock(), done), "", False


def is_quiet() -> bool:
    """Whether the user wants neither progress nor notes."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.find_root().params.get("quiet"))


def echo(line: object, *, err: bool = False) -> None:
    """Prints one line, which names from files can neither end nor make a terminal obey."""
    click.echo(printable(str(line)), err=err)


def note(sentence: str) -> None:
    """Prints on stderr what is good to know; to users who want no notes, if it is a warning."""
    if sentence.startswith("warning:") or not is_quiet():
        echo(sentence, err=True)


@contextmanager
def progress(what: str, kept: Callable[[], str] = lambda: "nothing was written.") -> Iterator[Display]:
    """Says on stderr what is being done for the time of the block: `what` at first, then what is begun.

    On a terminal a bar is redrawn. Elsewhere, such as in a file or a program, plain lines come at intervals of less
    than ten seconds. Results are printed after the block.

    Args:
        kept: says, if Ctrl-C stops the block, what is kept and how to go on.
    """
    try:
        with _display(what) as display:
            yield display
    except KeyboardInterrupt:
        echo(f"stopped; {kept()}", err=True)
        raise


@contextmanager
def _display(what: str) -> Iterator[Display]:
    console = Console(stderr=True)
    if is_quiet():
        yield SilentDisplay()
        return
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
        TaskProgressColumn(),
        TimeElapsedColumn(),
        _TimeLeftColumn(),
        TextColumn("{task.fields[note]}", style="cyan", markup=False),
        console=console,
    )


def output_console() -> Console:
    """The console on stdout; if that is no terminal, without colours and wrapping, whatever COLUMNS says."""
    return Console() if sys.stdout.isatty() else Console(width=_UNBOUNDED, force_terminal=False, no_color=True)


def print_json(document: object) -> None:
    """Prints the only JSON document that a command prints on stdout."""
    click.echo(json.dumps(document, indent=2))


def print_table(table: Table) -> None:
    """Prints a table on stdout: on a terminal as it is, elsewhere whole, in plain columns with two spaces between."""
    console = output_console()
    if console.is_terminal:
        found = console.render(table)
        console.print(Segments(Segment(printable(each.text, breaks=True), each.style) for each in found), end="")
        return
    table.box, table.pad_edge = None, False
    title, caption = table.title, table.caption
    table.title = table.caption = None  # they would be wrapped to the table's width
    with console.capture() as captured:
        console.print(table)
    for line in (title, *captured.get().splitlines(), caption):
        if line is not None:
            echo(str(line).rstrip())
