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
    before, again = sys.unraisablehook, list[threading.Timer]()
    sys.unraisablehook = lambda lost: again.append(_again(lost.exc_value)) if _is_stop(lost) else before(lost)
    for number in ending:
        signal.signal(number, handlers[number])
    try:
        yield
    finally:
        sys.unraisablehook = before
        for timer in again:  # else it would end a process that is already stopping, or has all but ended
            timer.cancel()
        for number in ending:
            signal.signal(number, signal.SIG_DFL)


def _is_stop(lost: Any) -> bool:
    return issubclass(lost.exc_type, KeyboardInterrupt)


def _again(lost: BaseException | None) -> threading.Timer:
    """Sends the signal once more, later: it came in a destructor or a callback, from which nothing is raised."""
    timer = threading.Timer(_LATER_SECONDS, _send, [_number(lost)])
    timer.daemon = True
    timer.start()
    return timer


def _send(number: signal.Signals) -> None:
    """Sends this process a signal, as from outside."""
    main = threading.main_thread().ident
    if hasattr(signal, "pthread_kill") and main is not None:
        signal.pthread_kill(main, number)
    else:  # Windows
        _thread.interrupt_main(number)
