"""A uniform grid over 2D triangles: a query needs to test only the triangles in the point's cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

MOST_CELLS = 256
"""Maximum number of cells along a side of a grid."""
_PER_TRIANGLE = 8  # maximum number of grid entries per triangle, on average
_SLACK = 1e-6  # of a cell: without it, rounding could miss a cell that a corner or an edge only touches
_FEW = 1 << 14  # with fewer triangles than this, the limit on entries is that of this many


@dataclass(frozen=True, eq=False)
class CellGrid:
    """A square grid over the bounding box of 2D triangles. Cells are numbered row by row.

    Attributes:
        low: lower corner of the grid.
        cell: side length of a cell.
        side: number of cells along a side of the grid.
    """

    low: Float[ndarray, " 2"]
    cell: float
    side: int

    @classmethod
    def around(cls, corners: Float[ndarray, "triangles 3 2"], side: float) -> CellGrid:
        """A grid of at most `side` (1 to `MOST_CELLS`) cells along a side, halved until `entries` are few."""
        lows, highs = boxes(corners)
        low = lows.min(axis=0)
        extent = max(float((highs.max(axis=0) - low).max()), 1e-300)
        cells = int(np.clip(side, 1, MOST_CELLS))
        while True:
            grid = cls(low, extent / cells, cells)
            count = (grid._place(highs) - grid._place(lows) + 1).prod(axis=1).sum()
            if cells == 1 or count <= _PER_TRIANGLE * max(len(corners), _FEW):
                return grid
            cells //= 2

    def cells(self, points: Float[ndarray, "points 2"]) -> Int[ndarray, " points"]:
        """The cell of each point. Points outside the grid get the nearest cell."""
        col, row = self._place(points).T
        return row * self.side + col

    def entries(
        self, corners: Float[ndarray, "triangles 3 2"]
    ) -> tuple[Int[ndarray, " entries"], Int[ndarray, " entries"]]:
        """The pairs (triangle, cell) where the triangle's bounding box overlaps the cell, sorted by triangle."""
        low, high = (self._place(corner) for corner in boxes(corners))
        size = high - low + 1
        count = size.prod(axis=1)
        triangle, step = ranges(np.zeros_like(count), count)
        row, col = np.divmod(step, size[triangle, 0])
        return triangle, (low[triangle, 1] + row) * self.side + low[triangle, 0] + col

    def overlaps(
        self, corners: Float[ndarray, "triangles 3 2"]
    ) -> tuple[Int[ndarray, " entries"], Int[ndarray, " entries"]]:
        """The pairs (triangle, cell) where the triangle itself overlaps the cell, sorted by triangle.

        These are a subset of `entries`, much smaller for slivers. The test is conservative by a millionth of a cell.
        """
        local = (corners - self.low) / self.cell
        lows, highs = boxes(local)
        bottom, top = (
            np.clip(y, 0, self.side - 1).astype(np.int64) for y in (lows[:, 1] - _SLACK, highs[:, 1] + _SLACK)
        )
        triangle, row = ranges(bottom, top - bottom + 1)
        corner = np.ascontiguousarray(local.T).take(triangle, axis=2)
        left, right = _spans(corner, row - _SLACK, row + 1.0 + _SLACK)
        first, last = (np.clip(x, 0, self.side - 1).astype(np.int64) for x in (left - _SLACK, right + _SLACK))
        span, col = ranges(first, np.maximum(last - first + 1, 0))
        return triangle[span], row[span] * self.side + col

    def _place(self, points: Float[ndarray, "points 2"]) -> Int[ndarray, "points 2"]:
        """Column and row of the cell of each point."""
        return np.clip((points - self.low) / self.cell, 0, self.side - 1).astype(np.int64)


def boxes(corners: Float[ndarray, " n 3 *k"]) -> tuple[Float[ndarray, " n *k"], Float[ndarray, " n *k"]]:
    """The least and the greatest corner of each triangle's bounding box; faster than NumPy's reduction of three."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def ranges(start: Int[ndarray, " n"], count: Int[ndarray, " n"]) -> tuple[Int[ndarray, " m"], Int[ndarray, " m"]]:
    """The concatenated ranges start[i] ... start[i] + count[i] - 1: the index i of each number, and the number."""
    owner = np.repeat(np.arange(len(start)), count)
    return owner, np.arange(len(owner)) + np.repeat(start - (np.cumsum(count) - count), count)


def _spans(
    corners: Float[ndarray, "2 3 n"], low: Float[ndarray, " n"], high: Float[ndarray, " n"]
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """The least and the greatest x of each triangle within its strip low <= y <= high; (inf, -inf) if it misses it."""
    (x0, y0), (x1, y1) = np.roll(corners, 1, axis=1), corners  # the ends of the three edges
    rise = y1 - y0
    # a horizontal edge has no crossing with a line; the other two edges contribute its end points
    slope = np.where(rise != 0.0, (x1 - x0) / np.where(rise != 0.0, rise, 1.0), 0.0)
    below, above = np.minimum(y0, y1), np.maximum(y0, y1)
    within = (above >= low) & (below <= high)
    crossings = [x0 + (np.clip(line, below, above) - y0) * slope for line in (low, high)]
    least, greatest = np.minimum(x0, x1), np.maximum(x0, x1)
    left = np.maximum(np.minimum(*crossings), least)
    right = np.minimum(np.maximum(*crossings), greatest)
    return np.where(within, left, np.inf).min(axis=0), np.where(within, right, -np.inf).max(axis=0)
