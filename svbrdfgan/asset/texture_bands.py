"""Rows of a texture over the asset's own UVs: which point of the surface each texel shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.geometry.rasterize import rasterize_triangles

_TEXELS_AT_ONCE = 1 << 19


@dataclass(frozen=True, eq=False)
class Band:
    """Some rows of a texture; row 0 of the texture is at v = 0.

    Attributes:
        rows: their numbers, which may reach beyond the texture.
        covered: texels whose centre lies in a face.
        points: of the covered texels, row by row, on the mesh.
    """

    rows: range
    covered: Bool[ndarray, "rows cols"]
    points: SurfacePoints


def bands(
    uv: Float[ndarray, "faces 3 2"], faces: Int[ndarray, " faces"], rows: int, cols: int, halo: int = 0
) -> Iterator[Band]:
    """A texture from its bottom to its top, in bands of bounded size.

    Args:
        uv: of the corners of some of the mesh's faces, in [0, 1].
        faces: the numbers of these in the mesh.
        halo: rows that each band has beyond its own at either side; those outside of the texture are empty.
    """
    height = max(1, _TEXELS_AT_ONCE // cols)
    for first in range(0, rows, height):
        yield band(uv, faces, (rows, cols), range(first - halo, min(first + height, rows) + halo))


def band(uv: Float[ndarray, "faces 3 2"], faces: Int[ndarray, " faces"], size: tuple[int, int], rows: range) -> Band:
    """Some rows of a texture of `size` (rows, cols); see `bands`."""
    corners = uv * size[::-1] - 0.5
    chosen = np.flatnonzero((corners[..., 1].max(axis=1) >= rows.start) & (corners[..., 1].min(axis=1) <= rows.stop))
    moved = corners[chosen] - (0.0, float(rows.start))
    raster = rasterize_triangles(moved, np.zeros((len(chosen), 3)), len(rows), size[1])
    covered = raster.mask
    return Band(rows, covered, SurfacePoints(faces[chosen[raster.face[covered]]], raster.barycentric[covered]))
