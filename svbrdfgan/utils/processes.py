"""Worker processes, CPU count, and PYTHONPATH for child processes."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from multiprocessing import active_children, current_process, get_context, parent_process
from multiprocessing.context import SpawnContext, SpawnProcess
from multiprocessing.sharedctypes import Synchronized
from typing import Any

from svbrdfgan.errors import AssetError, ConfigError

_GRACE_SECONDS = 1.0
"""How long a worker that is stopped may tidy up."""
_PARENT_CHECK_SECONDS = 0.5
_KILL = 9
"""The signal of that number, which Windows has no name for."""
_USUAL = 8
"""Worker processes, at most, if nobody says how many: each takes memory, of a GPU, too."""
_UNGUARDED = 79
"""The exit code of a worker that would start workers of its own before it has begun."""
_UNTOLD = "ignore:resource_tracker:UserWarning"
"""What Python's own process prints after it has tidied up behind a program that was killed."""
_started: list[bool] = []
"""Holds something in a worker that has begun to take work."""


@contextmanager
def worker_pool(
    workers: int, work: str, option: str, start: Callable[..., None] | None = None, given: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Processes of one PyTorch thread each. They are spawned, so they import the caller's main module.

    Args:
        work, option: what they do, and which option of the command says how many they are, for messages.
        start: each process calls it with what is `given`.

    Raises:
        AssetError: a process ended while the block waited for it.
        ConfigError: the main module asks for processes when it is imported, as each of them does.
        KeyboardInterrupt: after Ctrl-C or SIGTERM, which end the processes without a word.
    """
    if getattr(current_process(), "_inheriting", False):  # it still imports the main module
        os._exit(_UNGUARDED)
    _hush()
    context = _Context()
    pool = ProcessPoolExecutor(workers, context, _start, (start, given))
    try:
        yield pool
    except KeyboardInterrupt:
        _end(active_children())
        raise
    except BrokenProcessPool as error:
        raise _reason(context.made, work, option) from error
    finally:
        pool.shutdown(cancel_futures=True)


def shared_count() -> Synchronized[int]:
    """A whole number that the workers of a pool may share, 0 at first."""
    _hush()
    count: Synchronized[int] = get_context("spawn").Value("q", 0)
    return count


def _hush() -> None:
    """Keeps Python's resource tracker, a process of its own, from printing what it tidied up after a kill.

    Once that process has begun, this comes too late.
    """
    if _UNTOLD not in sys.warnoptions:  # which Python hands on to the processes that it starts
        sys.warnoptions.append(_UNTOLD)


def _reason(processes: list[SpawnProcess], work: str, option: str) -> AssetError | ConfigError:
    """Why a pool is broken, by how the first of its processes ended that nobody ended."""
    codes = [code for code in map(_exit_code, processes) if code not in (None, 0, -signal.SIGTERM)]
    code = codes[0] if codes else -signal.SIGTERM
    if code == _UNGUARDED:
        return ConfigError(f'a script that asks for several {option} needs its `if __name__ == "__main__":`.')
    if code == -_KILL:
        return AssetError(f"a process that {work} was killed, probably for memory; try fewer {option}.")
    ended = f"signal {-code}" if code < 0 else f"exit code {code}"
    return AssetError(f"a process that {work} ended with {ended}: run the command again, with {option} 1 to see why.")


def _exit_code(process: SpawnProcess) -> int | None:
    """How a process ended; None if it does not end soon.

    The system tells one thread alone. If that is the pool's, this one waits until the pool's has written it down.
    """
    process.join(_GRACE_SECONDS)
    until = time.monotonic() + _GRACE_SECONDS
    while process.exitcode is None and time.monotonic() < until:
        time.sleep(0.01)
    return process.exitcode


class _Process(SpawnProcess):
    """A process that no Ctrl-C reaches before `_start`, since Python would print a traceback while it starts."""

    def start(self) -> None:
        if not hasattr(signal, "pthread_sigmask"):  # Windows
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # which the process inherits
        try:
            super().start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Context(SpawnContext):
    """Makes such processes, and remembers them."""

    def __init__(self) -> None:
        super().__init__()
        self.made: list[SpawnProcess] = []

    def Process(self, *args: Any, **named: Any) -> SpawnProcess:  # type: ignore[override]  # noqa: N802
        self.made.append(_Process(*args, **named))
        return self.made[-1]


def _start(start: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, _stop)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import torch

    torch.set_num_threads(1)
    if start is not None:
        start(*given)
    _started.append(True)


def _end_with_parent() -> None:
    """Ends a worker whose parent was killed."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def _stop(number: int, frame: Any) -> None:
    """Ends a worker without a word, after what it is in the midst of has tidied up."""
    if not _started:
        os._exit(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    timer = threading.Timer(_GRACE_SECONDS, os._exit, [1])  # else it would take the next piece of work
    timer.daemon = True
    timer.start()
    sys.exit(1)


def _end(processes: list[Any]) -> None:
    for process in processes:
        if os.name == "posix" and process.is_alive():
            with suppress(ProcessLookupError):  # the pool's thread saw it end just now
                os.kill(process.pid, signal.SIGINT)
    for process in processes:
        process.join(2 * _GRACE_SECONDS)
        process.kill()


def end_with_parent(parent: int) -> None:
    """Starts a thread that kills this process when its parent dies, and its children if it leads a process group.

    Does nothing outside POSIX.

    Args:
        parent: id of the process that started this one; it may be dead already.
    """
    if os.name == "posix":
        threading.Thread(target=_watch, args=[parent], daemon=True).start()


def _watch(parent: int) -> None:
    while os.getppid() == parent:  # a process whose parent dies gets another parent
        time.sleep(_PARENT_CHECK_SECONDS)
    if os.getpgrp() == os.getpid():
        os.killpg(0, _KILL)
    os.kill(os.getpid(), _KILL)


def cores() -> int:
    """The CPU cores that this process may use, where the system says; else all of them."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def usual_workers(wanted: int | None, tasks: int) -> int:
    """Worker processes for so many tasks: as many as are wanted, by default one for each core, but at most 8."""
    return min(min(cores(), _USUAL) if wanted is None else wanted, tasks)


def import_path() -> str:
    """The `PYTHONPATH` with which a child process, started with `-P`, can import what this process can."""
    return os.pathsep.join(folder or os.getcwd() for folder in sys.path)
