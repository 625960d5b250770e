"""Triangles of the plane sorted into square cells, so that few need to be tried at a place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

MOST_CELLS = 256
"""Along a side of a grid."""
_PER_TRIANGLE = 8  # entries, on average
_SLACK = 1e-6  # of a cell: rounding must not lose a cell that a corner or an edge just touches
_FEW = 1 << 14  # triangles up to which as many entries are free as this many may have


@dataclass(frozen=True, eq=False)
class CellGrid:
    """Square cells over the box around some triangles; numbered row by row.

    Attributes:
        low: lower corner.
        cell: side of a cell.
        side: cells along a side.
    """

    low: Float[ndarray, " 2"]
    cell: float
    side: int

    @classmethod
    def around(cls, corners: Float[ndarray, "triangles 3 2"], side: float) -> CellGrid:
        """About `side` cells along a side (1 to `MOST_CELLS`); halved until `entries` are a few per triangle."""
        lows, highs = corners.min(axis=1), corners.max(axis=1)
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
        """The cell of each point; the nearest one for points outside."""
        col, row = self._place(points).T
        return row * self.side + col

    def entries(
        self, corners: Float[ndarray, "triangles 3 2"]
    ) -> tuple[Int[ndarray, " entries"], Int[ndarray, " entries"]]:
        """Each triangle with each cell that its box meets, triangles in order."""
        low = self._place(corners.min(axis=1))
        size = self._place(corners.max(axis=1)) - low + 1
        count = size.prod(axis=1)
        triangle, step = ranges(np.zeros_like(count), count)
        row, col = np.divmod(step, size[triangle, 0])
        return triangle, (low[triangle, 1] + row) * self.side + low[triangle, 0] + col

    def overlaps(
        self, corners: Float[ndarray, "triangles 3 2"]
    ) -> tuple[Int[ndarray, " entries"], Int[ndarray, " entries"]]:
        """Each triangle with each cell that it meets itself, triangles in order: fewer than `entries`, for slivers far.

        A cell that the triangle misses by less than a millionth of a cell may count as met.
        """
        local = (corners - self.low) / self.cell
        bottom, top = (
            np.clip(y, 0, self.side - 1).astype(np.int64)
            for y in (local[:, :, 1].min(axis=1) - _SLACK, local[:, :, 1].max(axis=1) + _SLACK)
        )
        triangle, row = ranges(bottom, top - bottom + 1)
        left, right = _spans(local[triangle], row - _SLACK, row + 1.0 + _SLACK)
        first, last = (np.clip(x, 0, self.side - 1).astype(np.int64) for x in (left - _SLACK, right + _SLACK))
        span, col = ranges(first, np.maximum(last - first + 1, 0))
        return triangle[span], row[span] * self.side + col

    def _place(self, points: Float[ndarray, "points 2"]) -> Int[ndarray, "points 2"]:
        """Column and row of the cell of each point."""
        return np.clip((points - self.low) / self.cell, 0, self.side - 1).astype(np.int64)


def ranges(start: Int[ndarray, " n"], count: Int[ndarray, " n"]) -> tuple[Int[ndarray, " m"], Int[ndarray, " m"]]:
    """The whole numbers from each start, as many as counted, with the index of the start that each belongs to."""
    owner = np.repeat(np.arange(len(start)), count)
    return owner, np.arange(len(owner)) + np.repeat(start - (np.cumsum(count) - count), count)


def _spans(
    corners: Float[ndarray, "n 3 2"], low: Float[ndarray, " n"], high: Float[ndarray, " n"]
) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """The least and greatest x of each triangle within its strip low <= y <= high; (inf, -inf) where it is not."""
    left, right = np.full(len(corners), np.inf), np.full(len(corners), -np.inf)
    for k in range(3):
        (x0, y0), (x1, y1) = corners[:, k - 1].T, corners[:, k].T
        rise = y1 - y0
        # a level edge needs no crossing: its ends are ends of the other two edges as well
        slope = np.where(rise != 0.0, (x1 - x0) / np.where(rise != 0.0, rise, 1.0), 0.0)
        below, above = np.minimum(y0, y1), np.maximum(y0, y1)
        within = (above >= low) & (below <= high)
        for line in (low, high):
            x = x0 + (np.clip(line, below, above) - y0) * slope
            x = np.clip(x, np.minimum(x0, x1), np.maximum(x0, x1))
            left = np.where(within & (x < left), x, left)
            right = np.where(within & (x > right), x, right)
    return left, right
