"""A crew tells each picture as soon as it is done, although parts of several come back at once."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from threading import Event
from typing import Any

import pytest

from svbrdfgan.data.photos import crew
from svbrdfgan.utils.display import SilentDisplay
from svbrdfgan.utils.processes import shared_count


class Counting(SilentDisplay):
    """Counts the steps, and says when there was one."""

    def __init__(self) -> None:
        self.steps, self.one = 0, Event()

    def advance(self, steps: int = 1, note: str = "") -> None:
        self.steps += steps
        if self.steps:
            self.one.set()


@pytest.mark.parametrize("pooled", [True, False])
def test_pictures_count_one_by_one(pooled: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """With one worker, eight pictures are four parts of two: the second waits until the first was told."""
    display, done, first = Counting(), shared_count(), Any
    monkeypatch.setattr(crew, "_own", [(first, done)])
    monkeypatch.setattr(crew, "_LOOK_SECONDS", 0.01)

    def work(converter: Any, number: int) -> tuple[int, bool]:
        return number, number != 1 or display.one.wait(10)

    with ThreadPoolExecutor(1) as pool:
        workers: Any = crew.Crew(first, pool, 1, done) if pooled else crew.Crew(first)
        assert list(workers.map(work, range(8), display)) == [(number, True) for number in range(8)]
    assert display.steps == 8
