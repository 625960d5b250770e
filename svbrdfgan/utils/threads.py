"""Work on threads, in order, a little ahead of whoever takes the results."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import torch

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
_worker = threading.local()


def in_threads(function: Callable[[_Item], _Result], items: Iterable[_Item]) -> Iterator[_Result]:
    """`function` of each item, in the items' order, on as many threads as torch has.

    NumPy and zlib free the interpreter while they compute, so threads suffice. At most two results a thread wait, which
    bounds memory. Inside of such a thread, and with one thread, the work is done in place.
    """
    threads = torch.get_num_threads()
    if threads == 1 or getattr(_worker, "busy", False):
        yield from map(function, items)
        return
    waiting: deque[Future[_Result]] = deque()
    with ThreadPoolExecutor(threads, initializer=_mark) as pool:
        try:
            for item in items:
                waiting.append(pool.submit(function, item))
                if len(waiting) > 2 * threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            for future in waiting:
                future.cancel()


def _mark() -> None:
    _worker.busy = True
