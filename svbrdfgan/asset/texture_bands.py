"""Rows of a texture over the asset's own UVs: which point of the surface each texel shows."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.geometry.rasterize import rasterize_triangles

TILE = 256
"""Texels along a side of a tile: a tile's arrays take a few megabytes each."""


@dataclass(frozen=True, eq=False)
class Band:
    """Some rows of a texture; row 0 of the texture is at v = 0.

    Attributes:
        rows: their numbers.
        covered: texels whose centre lies in a face.
        points: of the covered texels, row by row, on the mesh.
    """

    rows: range
    covered: Bool[ndarray, "rows cols"]
    points: SurfacePoints


def band(uv: Float[ndarray, "faces 3 2"], faces: Int[ndarray, " faces"], size: tuple[int, int], rows: range) -> Band:
    """Some rows of a texture of `size` (rows, cols), over the UVs of some of the mesh's faces; see `TexelGrid`."""
    return Band(rows, *TexelGrid(uv, faces, size).window(rows, range(size[1])))


@dataclass(frozen=True, eq=False)
class TexelGrid:
    """A texture over some of the mesh's faces.

    Attributes:
        uv: of the faces' corners, in [0, 1].
        faces: their numbers in the mesh.
        size: rows and columns.
    """

    uv: Float[ndarray, "faces 3 2"]
    faces: Int[ndarray, " faces"]
    size: tuple[int, int]

    def tiles(self) -> Iterator[tuple[range, range]]:
        """Rows and columns of the tiles, row by row from the bottom."""
        rows, cols = (
            [range(first, min(first + TILE, count)) for first in range(0, count, TILE)] for count in self.size
        )
        return itertools.product(rows, cols)

    def window(self, rows: range, cols: range) -> tuple[Bool[ndarray, "rows cols"], SurfacePoints]:
        """The texels that faces cover, and the points that they show; rows and columns may reach beyond the texture."""
        low, high = self._boxes
        near = (
            (low[:, 0] <= cols.stop)
            & (high[:, 0] >= cols.start)
            & (low[:, 1] <= rows.stop)
            & (high[:, 1] >= rows.start)
        )
        chosen = np.flatnonzero(near)
        corners = self.uv[chosen] * self.size[::-1] - 0.5 - (cols.start, rows.start)
        raster = rasterize_triangles(corners, np.zeros((len(chosen), 3)), len(rows), len(cols))
        covered = raster.mask
        return covered, SurfacePoints(self.faces[chosen[raster.face[covered]]], raster.barycentric[covered])

    @cached_property
    def _boxes(self) -> tuple[Float[ndarray, "faces 2"], Float[ndarray, "faces 2"]]:
        corners = self.uv * self.size[::-1] - 0.5
        return corners.min(axis=1), corners.max(axis=1)
