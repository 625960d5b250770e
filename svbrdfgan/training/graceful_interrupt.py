"""Ctrl-C between steps, rather than within one."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def defer_interrupts(wanted: bool = True) -> Iterator[Callable[[], bool]]:
    """Within, the first SIGINT is noted, and the second raised; it gives what tells whether one came.

    Nothing changes unless it is wanted, in threads other than the main one, and where SIGINT has a handler already.
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
