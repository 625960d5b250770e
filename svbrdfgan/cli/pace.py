"""How far a phase of a command is, and how long the rest of it takes."""

from __future__ import annotations

from dataclasses import dataclass

_MINUTE, _HOUR = 60, 3600


@dataclass
class Pace:
    """The steps of a phase.

    Attributes:
        total: steps; None where their number is not known.
        began: when this run began with it; seconds, as all times.
        earlier: steps that an earlier run has made.
        made: steps of this run.
        latest: when the last of them was made.
    """

    total: int | None
    began: float
    earlier: int = 0
    made: int = 0
    latest: float = 0.0

    def advance(self, steps: int, now: float) -> None:
        if steps:
            self.made, self.latest = self.made + steps, now

    @property
    def done(self) -> int:
        return self.earlier + self.made

    def seconds_left(self, now: float) -> float | None:
        """By the rate of this run; None before its first step, and where nothing can be known.

        A step that takes longer than those before it counts as if it ended now.
        """
        left = (self.total or 0) - self.done
        if left <= 0 or self.made <= 0:
            return None
        step = max((self.latest - self.began) / self.made, (now - self.began) / (self.made + 1))
        return left * step - min(now - self.latest, step)

    def count(self) -> str:
        """The steps that are done, such as `12 of 55 (22 %)`; empty if nobody counts any."""
        if not self.total:
            return str(self.done) if self.done else ""
        return f"{self.done} of {self.total} ({100 * self.done // self.total} %)"

    def left(self, now: float) -> str:
        """The time left, such as `40 s left`; empty if nobody knows, or it is over in a moment."""
        seconds = self.seconds_left(now)
        return "" if seconds is None or seconds < 0.5 else f"{duration(seconds)} left"


def duration(seconds: float) -> str:
    """Seconds to two minutes, then minutes, and from two hours on hours with minutes."""
    if seconds < 2 * _MINUTE:
        return f"{seconds:.0f} s"
    if seconds < 2 * _HOUR:
        return f"{seconds / _MINUTE:.0f} min"
    hours, minutes = divmod(round(seconds / _MINUTE), 60)
    return f"{hours} h {minutes} min"
