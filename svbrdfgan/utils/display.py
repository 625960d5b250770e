"""How long jobs say how far they are. The core speaks to a `Display`; the command line brings one that draws."""

from __future__ import annotations

from typing import Protocol


class Display(Protocol):
    """Shows the progress of one thing at a time."""

    def begin(self, what: str, total: int | None = None) -> None:
        """A new thing starts, of so many steps if that is known; the one before is over."""
        ...

    def advance(self, steps: int = 1, note: str = "") -> None:
        """So many steps are done; the note replaces the one before, if there is one."""
        ...


class Silent:
    """Shows nothing."""

    def begin(self, what: str, total: int | None = None) -> None:
        pass

    def advance(self, steps: int = 1, note: str = "") -> None:
        pass
