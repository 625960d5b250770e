"""A layer painted over the asset's own UVs: all maps at the texels of one material's texture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.painters import Paint, Painter
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.texture_bands import TILE, TexelGrid
from svbrdfgan.geometry.normals import corner_normals, face_areas, unit, uv_areas
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.geometry.tangents import Tangents, corner_tangents
from svbrdfgan.types import Mesh
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.threads import in_threads

CHANNELS = 9
"""Of a painted texture: base colour (3), alpha, roughness, metallic, and the normal in tangent space (3)."""
COLOR, ALPHA, ROUGHNESS, METALLIC, NORMAL = slice(0, 3), 3, 4, 5, slice(6, 9)

_SAME_SHEET = 4.0  # texels: neighbours in UV that are further apart on the surface lie on other islands


@dataclass(frozen=True, eq=False)
class Model:
    """What a painter paints; what all of its textures need is computed once.

    Attributes:
        mesh: the asset's, nose at +Z.
        reversed: of all faces: those that are seen from the side that their winding calls the back.
    """

    mesh: Mesh
    reversed: Bool[ndarray, " mesh_faces"]

    @cached_property
    def areas(self) -> Float[ndarray, " mesh_faces"]:
        """Square metres of each face."""
        return face_areas(self.mesh.positions, self.mesh.faces)

    @cached_property
    def normals(self) -> Float[ndarray, "mesh_faces 3 3"]:
        """Unit normals at face corners."""
        return corner_normals(self.mesh.positions, self.mesh.faces)


@dataclass(frozen=True, eq=False)
class Canvas:
    """The faces that share one texture.

    Attributes:
        model: the whole model.
        faces: numbers of the faces in its mesh, in ascending order.
        uv: of their corners, in [0, 1], origin lower left; no two faces overlap.
    """

    model: Model
    faces: Int[ndarray, " faces"]
    uv: Float[ndarray, "faces 3 2"]

    @property
    def mesh(self) -> Mesh:
        """The model's."""
        return self.model.mesh

    def texel(self, rows: int, cols: int) -> float:
        """Metres along a texel's side, of the mean over the area."""
        area = self.model.areas[self.faces].sum()
        texels = np.abs(uv_areas(self.uv)).sum() * rows * cols
        return float(np.sqrt(area / max(texels, 1e-12)))

    def in_tangent_space(
        self, points: SurfacePoints, normals: Float[ndarray, "points 3"]
    ) -> Float[ndarray, "points 3"]:
        """Unit normals of the mesh's axes, in the tangent frames of the canvas's UVs."""
        own = np.searchsorted(self.faces, points.face)
        axes = self._tangents.frames(self.model.normals[self.faces], own, points.barycentric)
        return np.stack([(normals * axis).sum(axis=1) for axis in axes], axis=1)

    @cached_property
    def _tangents(self) -> Tangents:
        """Of the canvas's faces alone, under the normals that they have in the whole model."""
        mesh = Mesh(self.mesh.positions, self.mesh.faces[self.faces], self.mesh.face_part[self.faces], self.mesh.parts)
        return corner_tangents(surface_over(mesh, self.uv, normals=self.model.normals[self.faces]))


def paint_texture(
    canvas: Canvas, painter: Painter, rows: int, cols: int, what: str = "", display: Display | None = None
) -> Float[ndarray, "rows cols channels"]:
    """The layer of all maps, as float16; texels outside of the faces continue what is nearest, for any mip level.

    Tiles are painted on several threads; the result does not depend on how many there are.

    Args:
        what: the name of this phase for the display.
    """
    texture = np.zeros((rows, cols, CHANNELS), np.float16)
    known = np.zeros((rows, cols), bool)
    texel, grid = canvas.texel(rows, cols), TexelGrid(canvas.uv, canvas.faces, (rows, cols))

    def paint(tile: tuple[range, range]) -> None:
        halo = [range(own.start - 1, own.stop + 1) for own in tile]
        covered, points = grid.window(*halo)
        own = tuple(slice(each.start, each.stop) for each in tile)
        known[own] = covered[1:-1, 1:-1]
        if known[own].any():
            painted = _painted(canvas, covered, points, painter(points, texel))
            texture[own] = painted[1:-1, 1:-1]

    tiles, shown = list(grid.tiles()), display or SilentDisplay()
    shown.stage(what, len(tiles))
    for _ in in_threads(paint, tiles):
        shown.advance()
    fill(texture, known)
    return texture


def painted_scale(canvas: Canvas, painted: int, rows: int, cols: int) -> int:
    """The power of two by which the layer is painted coarser than the texture, nearest to the density asked for."""
    area = canvas.model.areas.sum()
    coarsest, scale = float(np.sqrt(2.0 * area)) / painted, 1
    while scale < 64 and canvas.texel(rows // (2 * scale), cols // (2 * scale)) <= coarsest:
        scale *= 2
    return scale


def _painted(
    canvas: Canvas, covered: Bool[ndarray, "rows cols"], points: SurfacePoints, paint: Paint
) -> Float[ndarray, "rows cols channels"]:
    """A tile with its halo."""
    made = np.zeros((*covered.shape, CHANNELS), np.float32)
    values = np.column_stack([paint.color, paint.alpha, paint.roughness, paint.metallic])
    made[covered, : NORMAL.start] = values
    if paint.normal is None:
        made[..., NORMAL] = _relief(canvas, covered, points, paint.height)
    else:
        made[covered, NORMAL] = canvas.in_tangent_space(points, paint.normal)
    return made


def _relief(
    canvas: Canvas, covered: Bool[ndarray, "rows cols"], points: SurfacePoints, height: Float[ndarray, " points"]
) -> Float[ndarray, "rows cols 3"]:
    """Unit normals in tangent space, from the slopes of the height between neighbouring texels of one island."""
    shape = covered.shape
    normal = np.zeros((*shape, 3), np.float32)
    normal[..., 2] = 1.0
    if not height.any():
        return normal
    heights, places = np.zeros(shape), np.full((*shape, 3), np.nan)
    # relief rises from the side that is seen, and tangent space belongs to the winding's front
    side = np.where(canvas.model.reversed[points.face], -1.0, 1.0)
    heights[covered], places[covered] = height * side, points.positions(canvas.mesh)
    slopes = [_slope(heights, places, axis) for axis in (1, 0)]
    normal[..., 0], normal[..., 1] = -slopes[0], -slopes[1]
    return unit(normal).astype(np.float32)


def _slope(
    heights: Float[ndarray, "rows cols"], places: Float[ndarray, "rows cols 3"], axis: int
) -> Float[ndarray, "rows cols"]:
    """The mean slope to the texels before and after along an axis; 0 where neither is on the same island."""
    step = np.linalg.norm(np.diff(places, axis=axis), axis=2)
    usual = np.nanmedian(step) if np.isfinite(step).any() else np.nan
    near = step < _SAME_SHEET * usual  # false where either is missing
    rise = np.where(near, np.diff(heights, axis=axis) / np.where(near, np.maximum(step, 1e-12), 1.0), 0.0)
    pads = ((0, 0), (1, 0)) if axis == 1 else ((1, 0), (0, 0))
    after = tuple(pad[::-1] for pad in pads)
    total = np.pad(rise, pads) + np.pad(rise, after)
    count = np.pad(near.astype(np.int64), pads) + np.pad(near.astype(np.int64), after)
    slope: Float[ndarray, "rows cols"] = total / np.maximum(count, 1)
    return slope


def fill(texture: Float[ndarray, "rows cols channels"], known: Bool[ndarray, "rows cols"]) -> None:
    """Fills unknown texels, in place, by the mean of the nearest known ones: those of the finest mip level with any."""
    rows, cols = known.shape
    if known.all() or not known.any() or min(rows, cols) == 1:
        if known.any():
            texture[~known] = texture[known].astype(np.float32).mean(axis=0)
        return
    tall, wide = -(-rows // 2), -(-cols // 2)
    weight = np.zeros((tall, wide), np.float32)
    coarse = np.zeros((tall, wide, texture.shape[2]), np.float32)
    for row in (0, 1):
        for col in (0, 1):
            mine, mask = texture[row::2, col::2], known[row::2, col::2]
            weight[: mask.shape[0], : mask.shape[1]] += mask
            coarse[: mask.shape[0], : mask.shape[1]] += np.where(mask[..., None], mine, 0)
    coarse /= np.maximum(weight, 1.0)[..., None]
    fill(coarse, weight > 0)
    for first in range(0, rows, TILE):
        low, at = np.nonzero(~known[first : first + TILE])
        texture[first + low, at] = coarse[(first + low) // 2, at // 2]
