"""Ctrl-C, and SIGTERM, with which schedulers and `kill` stop a program."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any

_LATER_SECONDS = 0.05
_IMPORT_SECONDS = 10.0
_IMPORTER = "<frozen importlib._bootstrap>"
"""The file of frames that import a module."""


def exit_code(stopped: KeyboardInterrupt) -> int:
    """The shells' code of a program that was stopped so: 143 by SIGTERM, else 130."""
    return 128 + _number(stopped)


def _number(stopped: BaseException | None) -> signal.Signals:
    given = () if stopped is None else stopped.args
    return signal.SIGTERM if given == (signal.SIGTERM,) else signal.SIGINT


def end_by_signals() -> None:
    """Lets Ctrl-C end the process without a word, as SIGTERM does, where nobody has said otherwise."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


@contextmanager
def stopped_by_signals() -> Iterator[None]:
    """Within the context, signals that would end the process raise KeyboardInterrupt, which is never lost.

    That is so in the main thread alone. While modules are imported, for at most some seconds, the signals wait:
    libraries swallow errors then, and go on half imported.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ending = [each for each in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(each) is signal.SIG_DFL]
    before, again = sys.unraisablehook, _Again()
    sys.unraisablehook = lambda lost: again.send(_number(lost.exc_value)) if _is_stop(lost) else before(lost)
    for number in ending:
        signal.signal(number, again.stop)
    try:
        yield
    finally:
        sys.unraisablehook = before
        try:
            again.end()
        finally:
            for number in ending:
                signal.signal(number, signal.SIG_DFL)
            exec("")  # the stop may have come within an exec or eval of text: Python would end by SIGINT until the next


def _imports(frame: FrameType | None) -> bool:
    """Whether the program is importing a module at this place."""
    while frame is not None and frame.f_code.co_filename != _IMPORTER:
        frame = frame.f_back
    return frame is not None


def _is_stop(lost: Any) -> bool:
    return issubclass(lost.exc_type, KeyboardInterrupt)


def raises_interrupt(handler: Any) -> bool:
    """Whether a signal's handler raises KeyboardInterrupt."""
    return handler is signal.default_int_handler or getattr(handler, "__func__", None) is _Again.stop


class _Again:
    """Sends signals once more, later: they came in destructors or callbacks, from which nothing is raised, or imports.

    After `end` none is sent: it would end a process that is already stopping, or has all but ended.
    """

    def __init__(self) -> None:
        self._sending = threading.Lock()
        self._over = False
        self._waits_until: float | None = None

    def stop(self, number: int, frame: FrameType | None) -> None:
        """A handler of signals.

        Raises:
            KeyboardInterrupt: no module is being imported.
        """
        now = time.monotonic()
        self._waits_until = self._waits_until or now + _IMPORT_SECONDS
        if now < self._waits_until and _imports(frame):
            self.send(signal.Signals(number))
        else:
            raise KeyboardInterrupt(number)

    def send(self, number: signal.Signals) -> None:
        timer = threading.Timer(_LATER_SECONDS, self._send, [number])
        timer.daemon = True
        timer.start()

    def end(self) -> None:
        with self._sending:
            self._over = True

    def _send(self, number: signal.Signals) -> None:
        """Sends this process a signal, as from outside."""
        main = threading.main_thread().ident
        with self._sending:
            if self._over:
                return
            if hasattr(signal, "pthread_kill") and main is not None:
                signal.pthread_kill(main, number)
            else:  # Windows
                _thread.interrupt_main(number)
