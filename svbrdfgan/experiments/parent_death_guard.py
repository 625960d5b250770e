"""A process that ends when the one that started it was killed, lest its successor find it still at work."""

from __future__ import annotations

import os
import signal
import time
from threading import Thread

_EVERY = 0.5


def end_with_parent(parent: int) -> None:
    """From now on, this process and those that it starts end, at once, when its parent is gone. On POSIX alone.

    It must lead a process group of its own.

    Args:
        parent: the process that started it, which may be gone already.
    """
    if os.name == "posix":
        Thread(target=_watch, args=[parent], daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_EVERY)
    os.killpg(0, signal.SIGKILL)
