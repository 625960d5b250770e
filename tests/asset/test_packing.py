"""xatlas is left alone until its threads sleep."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest

from svbrdfgan.asset.packing import new_atlas

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="what threads do is read from /proc")

Working = Callable[[float], object]


@pytest.fixture
def working() -> Iterator[Working]:
    """Starts a thread that works for some seconds."""
    threads: list[threading.Thread] = []

    def start(seconds: float) -> None:
        until = time.monotonic() + seconds

        def work() -> None:
            while time.monotonic() < until:
                pass

        threads.append(threading.Thread(target=work))
        threads[-1].start()

    yield start
    for thread in threads:
        thread.join()


def taken(work: Callable[[], object]) -> float:
    """Seconds that an atlas takes that starts such work."""
    began = time.monotonic()
    with new_atlas(SimpleNamespace(Atlas=work)):
        pass
    return time.monotonic() - began


def test_threads_of_an_atlas_are_waited_for_as_long_as_they_work(working: Working) -> None:
    assert taken(lambda: working(0.5)) >= 0.5


def test_not_for_ever(working: Working, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svbrdfgan.asset.packing._PATIENCE", 0.1)
    assert taken(lambda: working(3.0)) < 2.5


def test_nor_are_others(working: Working) -> None:
    working(3.0)
    assert taken(lambda: None) < 2.5
