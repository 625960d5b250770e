"""Graceful interrupt: Ctrl-C and SIGTERM take effect between steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from svbrdfgan.utils.stopping import raises_interrupt


@contextmanager
def defer_interrupts(wanted: bool = True) -> Iterator[Callable[[], int]]:
    """Only records the first SIGINT or SIGTERM within the context; the second raises KeyboardInterrupt.

    The context yields a function that says which signal was recorded, or 0. Nothing changes if not `wanted`, in threads
    other than the main one, and for a signal that would not raise KeyboardInterrupt.
    """
    came = 0
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    main = threading.current_thread() is threading.main_thread()
    deferred = [number for number, handler in before.items() if wanted and main and raises_interrupt(handler)]

    def note(number: int, frame: Any) -> None:
        nonlocal came
        came = number
        restore()

    def restore() -> None:
        for number in deferred:
            signal.signal(number, before[number])

    for number in deferred:
        signal.signal(number, note)
    try:
        yield lambda: came
    finally:
        if deferred:
            restore()
