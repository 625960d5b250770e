"""Worker processes, CPU count, and PYTHONPATH for child processes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import Any

from svbrdfgan.errors import AssetError


@contextmanager
def worker_pool(
    workers: int, work: str, option: str, start: Callable[..., None] | None = None, given: tuple[Any, ...] = ()
) -> Iterator[ProcessPoolExecutor]:
    """Processes of one PyTorch thread each. They are spawned, so they import the caller's main module.

    Args:
        work, option: what they do, and which option of the command says how many they are, for messages.
        start: each process calls it with what is `given`.

    Raises:
        AssetError: a process was killed while the block waited for it.
    """
    pool = ProcessPoolExecutor(workers, get_context("spawn"), _start, (start, given))
    try:
        yield pool
    except BrokenProcessPool as error:
        raise AssetError(f"a process that {work} was killed, probably for memory; try fewer {option}.") from error
    finally:
        pool.shutdown(cancel_futures=True)


def _start(start: Callable[..., None] | None, given: tuple[Any, ...]) -> None:
    import torch

    torch.set_num_threads(1)
    if start is not None:
        start(*given)


def cores() -> int:
    """The CPU cores that this process may use, where the system says; else all of them."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def import_path() -> str:
    """The `PYTHONPATH` with which a child process, started with `-P`, can import what this process can."""
    return os.pathsep.join(folder or os.getcwd() for folder in sys.path)
