"""Point location: find the 2D triangles that contain given points (parallel rays, or places in UV)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.cells import CellGrid, boxes

_PAIRS_AT_ONCE = 1 << 16  # (point, triangle) pairs per batch: its arrays fit into the CPU cache
_EDGE = 1e-9  # barycentric tolerance: points on an edge are in both triangles, so no ray passes between neighbours
_ROUNDS_A_STEP = 4  # rounds of `any_higher` before the number of triangles per round doubles
_POINTS_AT_ONCE = 1 << 14  # points per batch: its arrays fit into the CPU cache
_CELLS_A_TRIANGLE = 1.5  # cells along a side, per square root of the triangle count; the fastest value on vehicles


@dataclass(frozen=True, eq=False)
class Hits:
    """The pairs (point, triangle) where the point is inside the triangle or on its border.

    Attributes:
        point, triangle: indices.
        barycentric: barycentric coordinates of the point in the triangle.
    """

    point: Int[ndarray, " hits"]
    triangle: Int[ndarray, " hits"]
    barycentric: Float[ndarray, "hits 3"]


@dataclass(frozen=True, eq=False)
class PointLocator:
    """2D triangles in a uniform grid. Triangles without area have no hits.

    Attributes:
        rows: coefficients of x, y and 1 in each triangle's second barycentric coordinate, then in its third.
        grid: the grid.
        listed: triangle indices of all cells, concatenated; within a cell in the order of `ranked`.
        first: index of each cell's first entry in `listed`; a final entry holds the total (CSR layout).
    """

    rows: Float[ndarray, "6 triangles"]
    grid: CellGrid
    listed: Int[ndarray, " entries"]
    first: Int[ndarray, " cells+1"]

    @classmethod
    def of(
        cls, corners: Float[ndarray, "triangles 3 2"], ranked: Int[ndarray, " triangles"] | None = None
    ) -> PointLocator:
        """A locator for triangles of either winding.

        Args:
            ranked: the order in which triangles are tested; by default the order of their indices.
        """
        rows, good = _barycentric_rows(corners)
        ranked = np.arange(len(corners)) if ranked is None else ranked
        ranked = ranked[good[ranked]]
        grid = CellGrid.around(corners, max(8.0, _CELLS_A_TRIANGLE * len(corners) ** 0.5))
        rank, cell = grid.overlaps(corners[ranked])
        # a grid has at most 2^16 cells; for uint16, NumPy uses radix sort, which is ten times as fast
        order = np.argsort(cell.astype(np.uint16), kind="stable")
        first = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=grid.side**2))])
        return cls(rows, grid, ranked[rank[order]], first)

    def locate(self, points: Float[ndarray, "points 2"]) -> Iterator[Hits]:
        """The hits of all points, in batches of bounded size, sorted by point."""
        cell = self.grid.cells(points)
        count = self.first[cell + 1] - self.first[cell]
        total = np.cumsum(count)
        start = 0
        while start < len(points):
            done = total[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(total, done + _PAIRS_AT_ONCE, side="right")))
            point = np.repeat(np.arange(start, stop), count[start:stop])
            offset = self.first[cell[start:stop]] - (total[start:stop] - count[start:stop] - done)
            triangle = self.listed[np.arange(len(point)) + np.repeat(offset, count[start:stop])]
            bx, by, b1, cx, cy, c1 = (row[triangle] for row in self.rows)
            x, y = points[point].T
            b, c = bx * x + by * y + b1, cx * x + cy * y + c1
            inside = np.flatnonzero((b >= -_EDGE) & (c >= -_EDGE) & (b + c <= 1.0 + _EDGE))
            b, c = b[inside], c[inside]
            yield Hits(point[inside], triangle[inside], np.stack([1.0 - b - c, b, c], axis=1))
            start = stop

    def any_higher(
        self,
        points: Float[ndarray, "points 2"],
        level: Float[ndarray, " points"],
        height: Float[ndarray, "triangles 3"],
    ) -> Bool[ndarray, " points"]:
        """Whether any triangle that contains the point is higher there than the point's level.

        Args:
            height: heights of the triangles' corners. `ranked` must have sorted the triangles by their highest corner,
                descending.
        """
        table = np.concatenate([self.rows, height.T, boxes(height)[1][None]])
        cell = self.grid.cells(points)
        order = np.argsort(cell.astype(np.uint16), kind="stable")  # points of the same cell read the same triangles
        found = np.zeros(len(points), dtype=bool)
        for start in range(0, len(points), _POINTS_AT_ONCE):
            point = order[start : start + _POINTS_AT_ONCE]
            place, last = self.first[cell[point]], self.first[cell[point] + 1]
            x, y, z = *points[point].T, level[point]
            going, rounds = np.flatnonzero(place < last), 0
            while len(going):
                point, place, last, x, y, z = (values[going] for values in (point, place, last, x, y, z))
                # the first few triangles decide most points: test one per round at first, later up to 32
                entry = place + np.arange(1 << min(rounds // _ROUNDS_A_STEP, 5))[:, None]
                triangle = self.listed.take(entry, mode="clip")
                bx, by, b1, cx, cy, c1, h0, h1, h2, top = table.take(triangle, axis=1)
                b, c = bx * x + by * y + b1, cx * x + cy * y + c1
                a = 1.0 - b - c
                inside = (b >= -_EDGE) & (c >= -_EDGE) & (a >= -_EDGE) & (entry < last)
                higher = (inside & (a * h0 + b * h1 + c * h2 > z)).any(axis=0)
                found[point[higher]] = True
                place = entry[-1] + 1
                going = np.flatnonzero(~higher & (place < last) & (top[-1] > z))  # all later triangles are lower
                rounds += 1
        return found


def _barycentric_rows(
    corners: Float[ndarray, "triangles 3 2"],
) -> tuple[Float[ndarray, "6 triangles"], Bool[ndarray, " triangles"]]:
    """`PointLocator.rows`, and a mask of the triangles that have an area."""
    a, p, q = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    good = np.abs(area) > 1e-14 * np.maximum((p * p).sum(axis=1), (q * q).sum(axis=1))
    b = np.stack([q[:, 1], -q[:, 0]], axis=1)
    c = np.stack([-p[:, 1], p[:, 0]], axis=1)
    rows = np.concatenate([np.column_stack([v, -(v * a).sum(axis=1)]) for v in (b, c)], axis=1)
    return np.ascontiguousarray((rows / np.where(good, area, 1.0)[:, None]).T), good
