"""Which triangles of the plane lie over each of many points: rays of one direction, or points of the UV square."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.cells import Grid

_AT_ONCE = 1 << 21
_STEP = 4  # candidates tried at once
_EDGE = 1e-9  # barycentric: points on an edge belong to both sides, so that no ray slips between neighbours


@dataclass(frozen=True, eq=False)
class Stabs:
    """Every meeting of a point with a triangle, its border included.

    Attributes:
        point, triangle: which.
        barycentric: of the point in the triangle.
    """

    point: Int[ndarray, " stabs"]
    triangle: Int[ndarray, " stabs"]
    barycentric: Float[ndarray, "stabs 3"]


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles of the plane, sorted into cells. Those without area are never met.

    Attributes:
        weights: per triangle, the rows that give the second and third barycentric coordinate of (x, y, 1).
        listed: triangles, cell after cell; within a cell those with the greatest `top` first.
        top: of each triangle: what it is sorted by.
        first: where in `listed` each cell begins; one more at the end.
    """

    weights: Float[ndarray, "triangles 2 3"]
    grid: Grid
    listed: Int[ndarray, " entries"]
    top: Float[ndarray, " triangles"]
    first: Int[ndarray, " cells+1"]

    @classmethod
    def of(cls, corners: Float[ndarray, "triangles 3 2"], top: Float[ndarray, " triangles"] | None = None) -> Triangles:
        """The triangles, wound either way."""
        top = np.zeros(len(corners)) if top is None else top
        weights, good = _barycentric_rows(corners)
        grid = Grid.around(corners, max(8.0, len(corners) ** 0.5))
        triangle, cell = grid.entries(corners[good])
        triangle = np.flatnonzero(good)[triangle]
        first = np.concatenate([[0], np.cumsum(np.bincount(cell, minlength=grid.side**2))])
        return cls(weights, grid, triangle[np.lexsort((-top[triangle], cell))], top, first)

    def over(self, points: Float[ndarray, "points 2"]) -> Iterator[Stabs]:
        """All meetings, in pieces of bounded size, points in order."""
        cell = self.grid.cells(points)
        count = self.first[cell + 1] - self.first[cell]
        total = np.cumsum(count)
        start = 0
        while start < len(points):
            done = total[start - 1] if start else 0
            stop = max(start + 1, int(np.searchsorted(total, done + _AT_ONCE, side="right")))
            point = np.repeat(np.arange(start, stop), count[start:stop])
            offset = self.first[cell[start:stop]] - (total[start:stop] - count[start:stop] - done)
            triangle = self.listed[np.arange(len(point)) + np.repeat(offset, count[start:stop])]
            yield self._meet(points, point, triangle)
            start = stop

    def any_higher(
        self,
        points: Float[ndarray, "points 2"],
        level: Float[ndarray, " points"],
        height: Float[ndarray, "triangles 3"],
    ) -> Bool[ndarray, " points"]:
        """Whether a triangle over the point is higher there than its level; `height` is at the corners, up to `top`.

        From the top down, a few candidates at a time, until one is found or none can be.
        """
        cell = self.grid.cells(points)
        place, last = self.first[cell], self.first[cell + 1]
        found = np.zeros(len(points), dtype=bool)
        active = np.flatnonzero(place < last)
        while len(active):
            point, entry = np.repeat(active, _STEP), (place[active, None] + np.arange(_STEP)).ravel()
            below = entry >= last[point]
            triangle = self.listed[np.where(below, 0, entry)]
            below |= self.top[triangle] <= level[point]
            met = self._meet(points, point[~below], triangle[~below])
            above = np.einsum("sk,sk->s", met.barycentric, height[met.triangle]) > level[met.point]
            found[met.point[above]] = True
            place[active] += _STEP
            active = active[~found[active] & ~below.reshape(-1, _STEP)[:, -1]]
        return found

    def _meet(self, points: ndarray, point: Int[ndarray, " pairs"], triangle: Int[ndarray, " pairs"]) -> Stabs:
        """The pairs that meet, of those that share a cell."""
        x, y = points[point, 0], points[point, 1]
        b, c = (row[:, 0] * x + row[:, 1] * y + row[:, 2] for row in np.moveaxis(self.weights[triangle], 1, 0))
        inside = (b >= -_EDGE) & (c >= -_EDGE) & (b + c <= 1.0 + _EDGE)
        b, c = b[inside], c[inside]
        return Stabs(point[inside], triangle[inside], np.stack([1.0 - b - c, b, c], axis=1))


def _barycentric_rows(
    corners: Float[ndarray, "triangles 3 2"],
) -> tuple[Float[ndarray, "triangles 2 3"], Bool[ndarray, " triangles"]]:
    """See `Triangles.weights`; and which triangles have an area."""
    a, p, q = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
    good = np.abs(area) > 1e-14 * np.maximum((p * p).sum(axis=1), (q * q).sum(axis=1))
    b = np.stack([q[:, 1], -q[:, 0]], axis=1)
    c = np.stack([-p[:, 1], p[:, 0]], axis=1)
    rows = np.stack([np.column_stack([v, -(v * a).sum(axis=1)]) for v in (b, c)], axis=1)
    return rows / np.where(good, area, 1.0)[:, None, None], good
