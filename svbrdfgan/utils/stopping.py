"""SIGTERM, with which schedulers and `kill` stop a program, is as Ctrl-C."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


def stop(number: int, frame: Any) -> None:
    """A handler of SIGTERM with which it is as Ctrl-C.

    Raises:
        KeyboardInterrupt: always.
    """
    raise KeyboardInterrupt(number)


def exit_code(stopped: KeyboardInterrupt) -> int:
    """The shells' code of a program that was stopped so: 143 by SIGTERM, else 130."""
    return 128 + (signal.SIGTERM if stopped.args == (signal.SIGTERM,) else signal.SIGINT)


@contextmanager
def stopped_by_sigterm() -> Iterator[None]:
    """Within the context, SIGTERM is as Ctrl-C; but not in other threads, or where the caller has a handler for it."""
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGTERM) is not signal.SIG_DFL:
        yield
        return
    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
