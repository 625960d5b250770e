"""Graceful interrupt: Ctrl-C takes effect between steps."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def defer_interrupts(wanted: bool = True) -> Iterator[Callable[[], bool]]:
    """Only records the first SIGINT within the context; the second raises KeyboardInterrupt.

    The context yields a function that says whether a SIGINT was recorded. Nothing changes if not `wanted`, in threads
    other than the main one, and where SIGINT has a handler of the caller's.
    """
    came = False
    before = signal.getsignal(signal.SIGINT)

    def note(number: int, frame: Any) -> None:
        nonlocal came
        came = True
        signal.signal(signal.SIGINT, before)

    main = threading.current_thread() is threading.main_thread()
    if not (wanted and main and before is signal.default_int_handler):
        yield lambda: False
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield lambda: came
    finally:
        signal.signal(signal.SIGINT, before)
