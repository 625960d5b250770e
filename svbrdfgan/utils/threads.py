"""Work on threads: items in order, a little ahead of whoever takes the results, or points by blocks."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

_Item = TypeVar("_Item")
_Result = TypeVar("_Result")
_worker = threading.local()

BLOCK = 16384
"""Points at a time: few enough that temporary arrays of 48 neighbours stay small."""


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


def by_blocks(
    function: Callable[..., Float[ndarray, "_ ..."]], *arrays: ndarray, shape: tuple[int, ...] = ()
) -> Float[ndarray, "points ..."]:
    """`function(*arrays)`, whose value at each point, of this shape, must depend on that point's row alone.

    The blocks do not change a bit of the result.
    """
    count = len(arrays[0])
    result = np.empty((count, *shape))

    def fill(start: int) -> None:
        rows = slice(start, start + BLOCK)
        result[rows] = function(*(array[rows] for array in arrays))

    for _ in in_threads(fill, range(0, count, BLOCK)):
        pass
    return result


def _mark() -> None:
    _worker.busy = True
