"""Which triangles of the plane overlap each other."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

TOLERANCE = 1e-6
"""Triangles that reach into each other by less than this do not overlap: neighbours are rounded apart in files."""

_AT_ONCE = 1 << 19
_MOST_CELLS = 256  # along a side


def overlapping_pairs(
    corners: Float[ndarray, "triangles 3 2"], group: Int[ndarray, " triangles"]
) -> Iterator[Int[ndarray, "pairs 2"]]:
    """The pairs of one group that overlap, in pieces of bounded size; a pair may come more than once.

    The triangles are wound counter-clockwise.
    """
    triangle, cell = _listed(corners)
    key = group[triangle] * (_MOST_CELLS**2) + cell
    order = np.argsort(key, kind="stable")
    triangle, key = triangle[order], key[order]
    last = np.searchsorted(key, key, side="right")
    after = last - np.arange(len(key)) - 1
    total = np.cumsum(after)
    start = 0
    while start < len(key):
        done = total[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(total, done + _AT_ONCE, side="right")))
        one = np.repeat(np.arange(start, stop), after[start:stop])
        step = np.arange(len(one)) - np.repeat(total[start:stop] - after[start:stop] - done, after[start:stop])
        pairs = triangle[np.stack([one, one + 1 + step], axis=1)]
        yield pairs[_overlap(corners[pairs[:, 0]], corners[pairs[:, 1]])]
        start = stop


def _listed(corners: Float[ndarray, "triangles 3 2"]) -> tuple[Int[ndarray, " entries"], Int[ndarray, " entries"]]:
    """Each triangle with each cell that its box meets, of a grid whose cells are about as large as the triangles."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    origin, extent = low.min(axis=0), max(float((high.max(axis=0) - low.min(axis=0)).max()), 1e-300)
    side = int(np.clip(extent / max(float((high - low).mean()), 1e-300), 1, _MOST_CELLS))
    first, last = (np.clip((ends - origin) * (side / extent), 0, side - 1).astype(np.int64) for ends in (low, high))
    size = last - first + 1
    count = size.prod(axis=1)
    triangle = np.repeat(np.arange(len(corners)), count)
    step = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
    row, col = np.divmod(step, size[triangle, 0])
    return triangle, (first[triangle, 1] + row) * _MOST_CELLS + first[triangle, 0] + col


def _overlap(one: Float[ndarray, "pairs 3 2"], other: Float[ndarray, "pairs 3 2"]) -> Bool[ndarray, " pairs"]:
    """Whether no edge of either has the other beyond it (separating axes)."""
    apart = np.zeros(len(one), dtype=bool)
    for a, b in ((one, other), (other, one)):
        for k in range(3):
            start = a[:, [k - 1]]
            along = a[:, k] - start[:, 0]
            inward = np.stack([-along[:, 1], along[:, 0]], axis=1)
            inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-300)
            depth = np.einsum("pkx,px->pk", b - start, inward)
            apart |= depth.max(axis=1) <= TOLERANCE
    return ~apart
