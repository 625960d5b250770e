"""The nearest face at points of a camera's picture, found by rasterisation, without a renderer."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import unit
from svbrdfgan.geometry.rasterize import rasterize_triangles
from svbrdfgan.geometry.texels import sample_texture
from svbrdfgan.types import Camera, Part, Surface

_NEAR = 1e-6
"""Of the diagonal of the surface's box: what lies less far before the camera is cut off."""
SEEN_THROUGH = 0.5
"""A point of smaller alpha does not end a ray."""


@dataclass(frozen=True, eq=False)
class CameraHits:
    """The first point of a surface at each point of a picture; row 0 is the top.

    Attributes:
        surface: the surface that is seen.
        face: index of the face, -1 where there is none.
        barycentric: coordinates of the point in its face; zero where there is none.
        depth: distance along the camera's line of sight, metres; zero where there is none.
        origin: of the camera.
    """

    surface: Surface
    face: Int[ndarray, "rows cols"]
    barycentric: Float[ndarray, "rows cols 3"]
    depth: Float[ndarray, "rows cols"]
    origin: Float[ndarray, " 3"]

    @property
    def hit(self) -> Bool[ndarray, "rows cols"]:
        return self.face >= 0

    @property
    def part(self) -> Int[ndarray, "rows cols"]:
        """Index of the surface's part, -1 where there is none."""
        return np.where(self.hit, self.surface.face_part[self.face], -1)

    def interpolate(self, attribute: Float[ndarray, " vertices *k"]) -> Float[ndarray, "rows cols *k"]:
        """A per-vertex attribute; zero where nothing is hit."""
        values, hit = np.zeros((*self.face.shape, *attribute.shape[1:])), self.hit
        corners = attribute[self.surface.faces[self.face[hit]]]
        values[hit] = np.einsum("nj,nj...->n...", self.barycentric[hit], corners)
        return values

    def centres(self, per_pixel: int) -> CameraHits:
        """The hits at the pixels' centres, of `per_pixel` hits along each side of a pixel, which is an odd number."""
        middle = (slice(per_pixel // 2, None, per_pixel),) * 2
        return replace(self, face=self.face[middle], barycentric=self.barycentric[middle], depth=self.depth[middle])

    def normals(self) -> Float[ndarray, "rows cols 3"]:
        """Unit shading normals in the world's axes, turned to the camera; zero where nothing is hit."""
        normal = self.interpolate(self.surface.normals)
        away = ((self.origin - self.interpolate(self.surface.positions)) * normal).sum(axis=-1, keepdims=True) < 0.0
        return np.where(self.hit[..., None], unit(np.where(away, -normal, normal)), 0.0)


def camera_hits(
    surface: Surface, camera: Camera, width: int, height: int, per_pixel: int = 1, band: range | None = None
) -> CameraHits:
    """The first points of a surface along rays through `per_pixel` x `per_pixel` regular points of each pixel.

    One point is the pixel's centre; so is the middle one, if their number along a side is odd. Rays pass through points
    of parts whose alpha there is below one half.

    Args:
        band: consecutive rows of the picture to look at; by default all of them.
    """
    band = range(height) if band is None else band
    right, up, backward = camera.basis()
    seen = surface.positions - np.asarray(camera.origin)
    depth = seen @ -backward
    pieces = _before_camera(depth[surface.faces], _NEAR * _diagonal(surface))
    ahead = pieces.interpolate(depth[surface.faces])
    scale = per_pixel * height / (2.0 * math.tan(camera.vertical_fov / 2.0))
    rows, cols = per_pixel * len(band), per_pixel * width
    middle = per_pixel * (height / 2.0 - band.start) - 0.5
    col = scale * pieces.interpolate((seen @ right)[surface.faces]) / ahead + (cols - 1) / 2.0
    row = -scale * pieces.interpolate((seen @ up)[surface.faces]) / ahead + middle

    def in_face(piece: Int[ndarray, " n"], flat: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
        """Barycentric coordinates in the surface, from those in a piece of the picture, where 1/depth is linear."""
        weight = flat / ahead[piece]
        return np.einsum("nj,nji->ni", weight / weight.sum(axis=-1, keepdims=True), pieces.barycentric[piece])

    def opaque(piece: Int[ndarray, " n"], flat: Float[ndarray, "n 3"]) -> Bool[ndarray, " n"]:
        return alpha_at(surface, pieces.face[piece], in_face(piece, flat)) >= SEEN_THROUGH

    # of a picture's points on a line of sight, 1/depth is greatest at the nearest, and linear over each face
    raster = rasterize_triangles(
        np.stack([col, row], axis=-1), 1.0 / ahead, rows, cols, keep=None if _all_opaque(surface.parts) else opaque
    )
    face, barycentric, hit = np.full((rows, cols), -1), np.zeros((rows, cols, 3)), raster.mask
    face[hit] = pieces.face[raster.face[hit]]
    barycentric[hit] = in_face(raster.face[hit], raster.barycentric[hit])
    distance = np.divide(1.0, raster.elevation, out=np.zeros((rows, cols)), where=hit)
    return CameraHits(surface, face, barycentric, distance, np.asarray(camera.origin))


def alpha_at(
    surface: Surface, face: Int[ndarray, " points"], barycentric: Float[ndarray, "points 3"]
) -> Float[ndarray, " points"]:
    """The alpha of the parts at points of the surface."""
    alpha, part = np.ones(len(face)), surface.face_part[face]
    for number, one in enumerate(surface.parts):
        mine = np.flatnonzero(part == number)
        if np.ndim(one.alpha) == 0:
            alpha[mine] = one.alpha
        elif len(mine):
            uv = np.einsum("nj,nji->ni", barycentric[mine], surface.uv[surface.faces[face[mine]]])
            texture = torch.as_tensor(one.alpha, dtype=torch.float64).unsqueeze(-1)
            alpha[mine] = sample_texture(texture, torch.from_numpy(uv), surface.repeat)[:, 0].numpy()
    return alpha


@dataclass(frozen=True, eq=False)
class _Pieces:
    """The pieces of faces that lie before a camera.

    Attributes:
        face: the face that each is a piece of.
        barycentric: of its corners in that face.
    """

    face: Int[ndarray, " pieces"]
    barycentric: Float[ndarray, "pieces 3 3"]

    def interpolate(self, attribute: Float[ndarray, "faces 3"]) -> Float[ndarray, "pieces 3"]:
        """Values at the pieces' corners, from those at the faces'."""
        return np.einsum("pji,pi->pj", self.barycentric, attribute[self.face])


def _before_camera(depth: Float[ndarray, "faces 3"], near: float) -> _Pieces:
    """The faces' pieces of at least that depth. What crosses it leaves one triangle, or two."""
    ahead = depth > near
    count = ahead.sum(axis=1)
    whole, one, two = (np.flatnonzero(count == number) for number in (3, 1, 2))
    first, left, right = _cuts(depth[one], np.argmax(ahead[one], axis=1), near)
    tips = np.stack([first[:, 0], left, right], axis=1)
    behind, low, high = _cuts(depth[two], np.argmin(ahead[two], axis=1), near)
    halves = [np.stack([low, behind[:, 1], behind[:, 2]], axis=1), np.stack([low, behind[:, 2], high], axis=1)]
    same = np.broadcast_to(np.eye(3), (len(whole), 3, 3))
    return _Pieces(np.concatenate([whole, one, two, two]), np.concatenate([same, tips, *halves]))


def _cuts(
    depth: Float[ndarray, "n 3"], odd: Int[ndarray, " n"], near: float
) -> tuple[Float[ndarray, "n 3 3"], Float[ndarray, "n 3"], Float[ndarray, "n 3"]]:
    """Corners of triangles from the odd one on, and where the edges from it to the next two have the depth `near`."""
    order = (odd[:, None] + np.arange(3)) % 3
    corners, there = np.eye(3)[order], np.take_along_axis(depth, order, axis=1)
    share = (near - there[:, :1]) / (there[:, 1:] - there[:, :1])
    cuts = corners[:, :1] + share[:, :, None] * (corners[:, 1:] - corners[:, :1])
    return corners, cuts[:, 0], cuts[:, 1]


def _all_opaque(parts: tuple[Part, ...]) -> bool:
    return all(np.min(part.alpha) >= SEEN_THROUGH for part in parts)


def _diagonal(surface: Surface) -> float:
    used = surface.positions[surface.faces]
    return float(np.linalg.norm(used.max(axis=(0, 1)) - used.min(axis=(0, 1))))
