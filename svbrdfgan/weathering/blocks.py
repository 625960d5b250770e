"""Functions of single points, evaluated by blocks: in the processor's cache, on as many threads as torch has."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.utils.threads import in_threads

BLOCK = 16384
"""Points at a time: few enough that temporary arrays of 48 neighbours stay small."""


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
