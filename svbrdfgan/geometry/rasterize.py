"""Which face each texel of the UV square sees: triangles rasterised at texel centres, the outermost on top."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import Surface

_CANDIDATES_AT_ONCE = 1 << 21


@dataclass(frozen=True, eq=False)
class Fragments:
    """Every meeting of a face with a texel's centre.

    Attributes:
        face, texel: which; texel = row * cols + col.
        barycentric: of the texel's centre in the face.
    """

    face: Int[ndarray, " fragments"]
    texel: Int[ndarray, " fragments"]
    barycentric: Float[ndarray, "fragments 3"]


@dataclass(frozen=True, eq=False)
class Raster:
    """The outermost face at each texel; row 0 is at v = 0.

    Attributes:
        face: index of the face, -1 where there is none.
        barycentric: of the texel's centre in that face, zero where there is none.
        elevation: of the outermost face, -inf where there is none.
        layers: how many faces lie over the texel's centre.
    """

    face: Int[ndarray, "rows cols"]
    barycentric: Float[ndarray, "rows cols 3"]
    elevation: Float[ndarray, "rows cols"]
    layers: Int[ndarray, "rows cols"]

    @property
    def mask(self) -> Bool[ndarray, "rows cols"]:
        return self.face >= 0

    def interpolate(
        self, faces: Int[ndarray, "faces 3"], attribute: Float[ndarray, " vertices *k"]
    ) -> Float[ndarray, "rows cols *k"]:
        """A per-vertex attribute at the texels' centres; zero where there is no face."""
        return np.einsum("rcj,rcj...->rc...", self.barycentric, attribute[faces[self.face]])


def rasterize(surface: Surface, rows: int, cols: int, only: Bool[ndarray, " faces"] | None = None) -> Raster:
    """The outermost face (greatest elevation, then lowest index) at each texel, among the faces chosen by `only`."""
    face = np.full(rows * cols, -1)
    barycentric = np.zeros((rows * cols, 3))
    top = np.full(rows * cols, -np.inf)
    layers = np.zeros(rows * cols, dtype=np.int64)
    for found in fragments(surface, rows, cols, only):
        layers += np.bincount(found.texel, minlength=rows * cols)
        height = fragment_elevation(surface, found)
        order = np.lexsort((-found.face, height, found.texel))
        last = order[np.diff(found.texel[order], append=-1) != 0]
        better = last[height[last] > top[found.texel[last]]]
        at = found.texel[better]
        face[at], barycentric[at], top[at] = found.face[better], found.barycentric[better], height[better]
    shape = (rows, cols)
    return Raster(face.reshape(shape), barycentric.reshape(*shape, 3), top.reshape(shape), layers.reshape(shape))


def fragment_elevation(surface: Surface, found: Fragments) -> Float[ndarray, " fragments"]:
    """Elevation at each fragment."""
    return np.einsum("fi,fi->f", found.barycentric, surface.elevation[surface.faces[found.face]])


def fragments(
    surface: Surface, rows: int, cols: int, only: Bool[ndarray, " faces"] | None = None
) -> Iterator[Fragments]:
    """All fragments, in pieces of bounded size, faces in order.

    A centre on an edge that two faces share belongs to one of them: the whole is watertight, and counts nothing twice.
    Faces without area in UV have none.
    """
    chosen = np.arange(len(surface.faces)) if only is None else np.flatnonzero(only)
    corners = surface.uv[surface.faces[chosen]] * (cols, rows) - 0.5  # texel centres lie at whole numbers
    low = np.clip(np.ceil(corners.min(axis=1)), 0, (cols, rows)).astype(np.int64)
    high = np.clip(np.floor(corners.max(axis=1)) + 1, low, (cols, rows)).astype(np.int64)
    width, count = (high - low)[:, 0], np.prod(high - low, axis=1)
    total = np.cumsum(count)
    start = 0
    while start < len(chosen):
        done = total[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(total, done + _CANDIDATES_AT_ONCE, side="right")))
        face = np.repeat(np.arange(start, stop), count[start:stop])
        step = np.arange(len(face)) - np.repeat(total[start:stop] - count[start:stop] - done, count[start:stop])
        col, row = low[face, 0] + step % width[face], low[face, 1] + step // width[face]
        inside, barycentric = _covered(corners, face, col, row)
        yield Fragments(chosen[face[inside]], (row * cols + col)[inside], barycentric)
        start = stop


def _covered(
    corners: Float[ndarray, "faces 3 2"], face: Int[ndarray, " n"], col: Int[ndarray, " n"], row: Int[ndarray, " n"]
) -> tuple[Bool[ndarray, " n"], Float[ndarray, "inside 3"]]:
    """Whether each face owns its point, and the point's barycentric coordinates where it does."""
    edges = [_Edge.between(corners[:, k - 2], corners[:, k - 1]) for k in range(3)]
    sides = [edge.side(face, col, row) for edge in edges]
    area = sides[0] + sides[1] + sides[2]
    left = area > 0
    inside = area != 0
    for edge, side in zip(edges, sides, strict=True):
        inside &= np.where(side == 0, edge.forward[face] == left, (side > 0) == left)
    return inside, np.stack([side[inside] for side in sides], axis=1) / area[inside, None]


@dataclass(frozen=True, eq=False)
class _Edge:
    """One edge of each face, kept from its lexicographically lower end, so that neighbours compute the same numbers."""

    low: Float[ndarray, "faces 2"]
    along: Float[ndarray, "faces 2"]
    forward: Bool[ndarray, " faces"]

    @classmethod
    def between(cls, a: Float[ndarray, "faces 2"], b: Float[ndarray, "faces 2"]) -> _Edge:
        forward = (a[:, 0] < b[:, 0]) | ((a[:, 0] == b[:, 0]) & (a[:, 1] < b[:, 1]))
        low = np.where(forward[:, None], a, b)
        return cls(low, np.where(forward[:, None], b, a) - low, forward)

    def side(self, face: Int[ndarray, " n"], col: Int[ndarray, " n"], row: Int[ndarray, " n"]) -> Float[ndarray, " n"]:
        """Twice the signed area of (a, b, point); of (b, a, point) it is exactly the negative."""
        x, y = col - self.low[face, 0], row - self.low[face, 1]
        area = self.along[face, 0] * y - self.along[face, 1] * x
        return np.where(self.forward[face], area, -area)
