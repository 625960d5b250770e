"""xatlas is left alone until its threads sleep."""

import sys
import threading
import time
from types import SimpleNamespace

import pytest

from svbrdfgan.asset.packing import generate


@pytest.mark.skipif(sys.platform != "linux", reason="what threads do is read from /proc")
def test_it_waits_for_threads_that_run_as_long_as_they_do_and_not_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    began, ends = time.monotonic(), [0.5]

    def work() -> None:
        while time.monotonic() < began + ends[0]:
            pass

    threads: list[threading.Thread] = []

    def start(charting: None, packing: None) -> None:
        threads.append(threading.Thread(target=work))
        threads[-1].start()

    generate(SimpleNamespace(generate=start), None, None)
    assert time.monotonic() >= began + 0.5
    monkeypatch.setattr("svbrdfgan.asset.packing._PATIENCE", 0.1)
    began, ends[0] = time.monotonic(), 3.0
    generate(SimpleNamespace(generate=start), None, None)
    assert time.monotonic() < began + 2.5
    for thread in threads:
        thread.join()
