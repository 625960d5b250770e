"""Triangles of the plane sorted into square cells, so that few need to be tried at a place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

MOST_CELLS = 256
"""Along a side of a grid."""
_PER_TRIANGLE = 8  # entries, on average
_FEW = 1 << 14  # triangles up to which as many entries are free as this many may have


@dataclass(frozen=True, eq=False)
class Grid:
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
    def around(cls, corners: Float[ndarray, "triangles 3 2"], side: float) -> Grid:
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
        triangle = np.repeat(np.arange(len(corners)), count)
        step = np.arange(len(triangle)) - np.repeat(np.cumsum(count) - count, count)
        row, col = np.divmod(step, size[triangle, 0])
        return triangle, (low[triangle, 1] + row) * self.side + low[triangle, 0] + col

    def _place(self, points: Float[ndarray, "points 2"]) -> Int[ndarray, "points 2"]:
        """Column and row of the cell of each point."""
        return np.clip((points - self.low) / self.cell, 0, self.side - 1).astype(np.int64)
