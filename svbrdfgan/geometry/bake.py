"""The geometry buffer (thesis, section 3.2): position, normal and more of the outermost surface at each texel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.normals import face_areas, face_normals, unit
from svbrdfgan.geometry.rasterize import Fragments, Raster
from svbrdfgan.geometry.texels import centroid_texels, nearest_texels
from svbrdfgan.types import Surface


@dataclass(frozen=True, eq=False)
class GeometryBuffer:
    """The outermost exposed surface at each texel's centre; row 0 is at v = 0.

    Attributes:
        position: in metres. Texels outside the mask have the position of the nearest texel inside.
        normal: unit shading normal, pointing outward; filled in the same way.
        mask: whether there is a visible surface at the texel.
        part: index into `Surface.parts`, -1 outside the mask.
        area: square metres of exposed surface that map to the texel, zero outside the mask.
        face: index into `Surface.faces`, -1 outside the mask.
        barycentric: barycentric coordinates of the texel's centre in that face.
        bounds: lower and upper corner of the box around the whole surface, metres.
    """

    position: Float[Tensor, "rows cols 3"]
    normal: Float[Tensor, "rows cols 3"]
    mask: Bool[Tensor, "rows cols"]
    part: Int[Tensor, "rows cols"]
    area: Float[Tensor, "rows cols"]
    face: Int[Tensor, "rows cols"]
    barycentric: Float[Tensor, "rows cols 3"]
    bounds: Float[Tensor, "2 3"]

    def network_input(self) -> Float[Tensor, "6 rows cols"]:
        """Position and normal for the generator, in [-1, 1], except heights, which start at 0 and may exceed 1.

        Positions are relative to the centre of the bounding box's bottom face, and divided by half the longer
        horizontal side. One scale for all axes keeps proportions; the input does not depend on the vehicle's size.
        """
        low, high = self.bounds
        ground = torch.stack([(low[0] + high[0]) / 2, low[1], (low[2] + high[2]) / 2])
        half = (high - low)[[0, 2]].max().clamp(min=1e-12) / 2
        return torch.cat([(self.position - ground) / half, self.normal], dim=-1).permute(2, 0, 1).contiguous()


def bake(fragments: Fragments) -> GeometryBuffer:
    """The geometry buffer of a rasterised surface. Only exposed faces (of parts that are not hidden) count.

    Raises:
        AssetError: no exposed face covers the centre of any texel.
    """
    surface = fragments.surface
    raster = fragments.outermost(exposed_faces(surface))
    if not raster.mask.any():
        size = f"{fragments.rows} x {fragments.cols}"
        raise AssetError(f"no face covers a texel of {size}; bake at a higher resolution or check the UVs.")
    nearest = nearest_texels(raster.mask)
    bounds = _bounds(surface)
    position = raster.interpolate(surface.faces, surface.positions)
    normal = _outward(surface, raster, position, bounds)
    part = np.where(raster.mask, surface.face_part[raster.face], -1)
    return GeometryBuffer(
        position=torch.from_numpy(position[nearest]).float(),
        normal=torch.from_numpy(normal[nearest]).float(),
        mask=torch.from_numpy(raster.mask),
        part=torch.from_numpy(part),
        area=torch.from_numpy(np.where(raster.mask, _texel_areas(fragments), 0.0)).float(),
        face=torch.from_numpy(raster.face),
        barycentric=torch.from_numpy(raster.barycentric).float(),
        bounds=torch.from_numpy(bounds).float(),
    )


def exposed_faces(surface: Surface) -> Bool[ndarray, " faces"]:
    """A mask of the faces in parts that are not hidden."""
    return ~np.array([part.hidden for part in surface.parts])[surface.face_part]


def _bounds(surface: Surface) -> Float[ndarray, "2 3"]:
    """Bounding box of the vertices that faces use."""
    used = surface.positions[np.unique(surface.faces)]
    return np.stack([used.min(axis=0), used.max(axis=0)])


def _outward(
    surface: Surface, raster: Raster, position: Float[ndarray, "rows cols 3"], bounds: Float[ndarray, "2 3"]
) -> Float[ndarray, "rows cols 3"]:
    """Unit shading normals, flipped where their face points towards the centre of the bounding box's bottom face.

    Surfaces are two-sided and meshes may be wound either way, but the outermost surface is seen from outside.
    A one-to-one embedding has elevation zero everywhere and no outermost surface: its normals are not flipped.
    """
    normal = unit(raster.interpolate(surface.faces, surface.normals))
    if not surface.elevation.any():
        return normal
    ground = bounds.mean(axis=0)
    ground[1] = bounds[0, 1]
    flat = face_normals(surface.positions, surface.faces)[raster.face]
    inward = np.einsum("rcx,rcx->rc", flat, position - ground) < 0
    return np.where(inward[..., None], -normal, normal)


def _texel_areas(fragments: Fragments) -> Float[ndarray, "rows cols"]:
    """Exposed area per texel: each face's area is spread evenly over its texels, or added to its centroid's texel.

    Of faces that reach beyond the map, as those of windows do, a texel has a texel's share.
    """
    surface, rows, cols = fragments.surface, fragments.rows, fragments.cols
    area, exposed = face_areas(surface.positions, surface.faces), exposed_faces(surface)
    covered = fragments.texels_of_faces.astype(np.float64)
    if not any(surface.repeat):
        corners = surface.uv[surface.faces]
        beyond = (covered > 0) & ((corners < 0.0) | (corners > 1.0)).any(axis=(1, 2))
        first, second = (corners[beyond, n] - corners[beyond, 0] for n in (1, 2))
        whole = 0.5 * np.abs(first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) * rows * cols
        covered[beyond] = np.maximum(covered[beyond], whole)
        middle = corners.mean(axis=1)
        exposed &= (covered > 0) | ((middle >= 0.0) & (middle <= 1.0)).all(axis=1)
    chosen = exposed[fragments.face]
    face, texel = fragments.face[chosen], fragments.texel[chosen]
    total = np.bincount(texel, area[face] / covered[face], rows * cols)
    small = exposed & (covered == 0)
    total += np.bincount(centroid_texels(surface, rows, cols)[small], area[small], rows * cols)
    return total.reshape(rows, cols)
