"""Finds the pairs of triangles in the plane that overlap."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.cells import CellGrid

TOLERANCE = 1e-6
"""Triangles overlap if they reach into each other by more than this: files round the shared corners of neighbours."""

_AT_ONCE = 1 << 19  # candidate pairs tested at once, which bounds memory


def overlapping_pairs(
    corners: Float[ndarray, "triangles 3 2"], group: Int[ndarray, " triangles"]
) -> Iterator[Int[ndarray, "pairs 2"]]:
    """The overlapping pairs of triangles in the same group, in batches of bounded size.

    The triangles must be wound counter-clockwise.
    """
    grid = _grid(corners)
    low = corners.min(axis=1)
    triangle, cell = grid.entries(corners)
    key = group[triangle] * grid.side**2 + cell
    order = np.argsort(key, kind="stable")
    triangle, cell, key = triangle[order], cell[order], key[order]
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
        pairs = pairs[grid.cells(low[pairs].max(axis=1)) == cell[one]]  # report a pair in only one of its shared cells
        yield pairs[_overlap(corners[pairs[:, 0]], corners[pairs[:, 1]])]
        start = stop


def _grid(corners: Float[ndarray, "triangles 3 2"]) -> CellGrid:
    """A grid whose cells are about as large as the triangles."""
    low, high = corners.min(axis=1), corners.max(axis=1)
    extent, mean = (high.max(axis=0) - low.min(axis=0)).max(), (high - low).mean()
    return CellGrid.around(corners, extent / max(mean, 1e-300))  # all triangles may be points


def _overlap(one: Float[ndarray, "pairs 3 2"], other: Float[ndarray, "pairs 3 2"]) -> Bool[ndarray, " pairs"]:
    """Whether no edge of one triangle separates it from the other (separating axis theorem)."""
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
