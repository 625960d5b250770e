"""The progress of long jobs. The core reports to a `Display`; the command line passes one that draws."""

from __future__ import annotations

from typing import Protocol


class Display(Protocol):
    """Shows the progress of one phase at a time."""

    def begin(self, what: str, total: int | None = None, done: int = 0) -> None:
        """Ends the phase before, and starts one of `total` steps; None where their number is not known.

        Args:
            done: steps that an earlier run has made, which say nothing of how fast this one is.
        """

    def stage(self, what: str, total: int | None = None) -> None:
        """Starts a phase, too, but one that mostly takes a second: nothing is said of it unless it lasts."""

    def advance(self, steps: int = 1, note: str = "") -> None:
        """Counts steps as done. A note replaces the one before; an empty one leaves it."""


class SilentDisplay:
    """Shows nothing."""

    def begin(self, what: str, total: int | None = None, done: int = 0) -> None:
        pass

    def stage(self, what: str, total: int | None = None) -> None:
        pass

    def advance(self, steps: int = 1, note: str = "") -> None:
        pass
