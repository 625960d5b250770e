"""Texels that show two places: where a UV map is not one-to-one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.islands import areas, extent, signed_areas
from svbrdfgan.geometry.rasterize import triangle_fragments

_FOOTPRINTS = 2.0  # points of the surface within so many texels of each other are one place to a texture
_NEAR, _FAR = 1e-5, 5e-3  # of the model's extent: bounds of that distance, since a palette's texels are metres wide


@dataclass(frozen=True, eq=False)
class TexelUse:
    """The faces over the centres of a texture's texels.

    Attributes:
        face, texel: all pairs where the texel's centre lies in the face; texel = row * cols + col.
        doubled: whether the pair's texel shows another place, too.
    """

    face: Int[ndarray, " fragments"]
    texel: Int[ndarray, " fragments"]
    doubled: Bool[ndarray, " fragments"]

    def doubled_share(self, count: int) -> Float[ndarray, " faces"]:
        """The share of each of `count` faces' texels that show another place, too; 0 for faces without texels."""
        total = np.bincount(self.face, minlength=count)
        return np.bincount(self.face, self.doubled, minlength=count) / np.maximum(total, 1)


def texel_use(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"], rows: int, cols: int
) -> TexelUse:
    """The faces over each texel's centre, and whether they are different places in space.

    Surfaces closer to each other than two texels' footprint count as one place, such as both sides of a sheet.
    """
    face, texel, barycentric = triangle_fragments(uv * (cols, rows) - 0.5, rows, cols)
    shared = np.flatnonzero(np.bincount(texel, minlength=rows * cols)[texel] > 1)
    shared = shared[np.argsort(texel[shared], kind="stable")]
    face_of, texel_of = face[shared], texel[shared]
    point = np.einsum("fi,fix->fx", barycentric[shared], positions[face_of])
    start = np.flatnonzero(np.diff(texel_of, prepend=-1))
    first = np.repeat(start, np.diff(np.append(start, len(texel_of))))
    reach = _reach(positions, uv, rows * cols)[face_of]
    apart = np.linalg.norm(point - point[first], axis=1) > np.maximum(reach, reach[first])
    if len(start):
        apart = np.repeat(np.logical_or.reduceat(apart, start), np.diff(np.append(start, len(texel_of))))
    doubled = np.zeros(len(face), dtype=bool)
    doubled[shared] = apart
    return TexelUse(face, texel, doubled)


def _reach(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"], texels: int
) -> Float[ndarray, " faces"]:
    """The distance within which points are one place, by the footprint of a texel on each face."""
    footprint = np.sqrt(areas(positions) / np.maximum(np.abs(signed_areas(uv)) * texels, 1e-300))
    size = extent(positions)
    return np.clip(_FOOTPRINTS * footprint, _NEAR * size, _FAR * size)
