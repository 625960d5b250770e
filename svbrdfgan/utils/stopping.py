"""Ctrl-C, and SIGTERM, with which schedulers and `kill` stop a program."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_LATER_SECONDS = 0.05


def stop(number: int, frame: Any) -> None:
    """A handler of SIGTERM with which it is as Ctrl-C.

    Raises:
        KeyboardInterrupt: always.
    """
    raise KeyboardInterrupt(number)


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

    That is so in the main thread alone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: stop}
    ending = [number for number in handlers if signal.getsignal(number) is signal.SIG_DFL]
    before, again = sys.unraisablehook, _Again()
    sys.unraisablehook = lambda lost: again.send(lost.exc_value) if _is_stop(lost) else before(lost)
    for number in ending:
        signal.signal(number, handlers[number])
    try:
        yield
    finally:
        sys.unraisablehook = before
        try:
            again.end()
        finally:
            for number in ending:
                signal.signal(number, signal.SIG_DFL)


def _is_stop(lost: Any) -> bool:
    return issubclass(lost.exc_type, KeyboardInterrupt)


class _Again:
    """Sends signals once more, later: they came in destructors or callbacks, from which nothing is raised.

    After `end` none is sent: it would end a process that is already stopping, or has all but ended.
    """

    def __init__(self) -> None:
        self._sending = threading.Lock()
        self._over = False

    def send(self, lost: BaseException | None) -> None:
        timer = threading.Timer(_LATER_SECONDS, self._send, [_number(lost)])
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
