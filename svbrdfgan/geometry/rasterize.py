"""Rasterisation of triangles in UV space: the faces at each texel's centre, and the outermost of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.cells import ranges
from svbrdfgan.types import Surface

_CANDIDATES_AT_ONCE = 1 << 18  # pairs (face, texel in its bounding box) per batch: its arrays fit into the CPU cache
_BLOCK = 8  # texels along a side of the blocks used to cull faces that are covered entirely
_SLACK = 1e-12  # of the greatest elevation: rounding can make an interpolated elevation exceed the corners'

Keep = Callable[[Int[ndarray, " n"], Float[ndarray, "n 3"]], Bool[ndarray, " n"]]


@dataclass(frozen=True, eq=False)
class Raster:
    """The outermost face at each texel; row 0 is at v = 0.

    Attributes:
        face: index of the outermost face, -1 where there is none.
        barycentric: barycentric coordinates of the texel's centre in that face, zero where there is none.
        elevation: elevation of that face at the texel's centre, -inf where there is none.
    """

    face: Int[ndarray, "rows cols"]
    barycentric: Float[ndarray, "rows cols 3"]
    elevation: Float[ndarray, "rows cols"]

    @property
    def mask(self) -> Bool[ndarray, "rows cols"]:
        return self.face >= 0

    def interpolate(
        self, faces: Int[ndarray, "faces 3"], attribute: Float[ndarray, " vertices *k"]
    ) -> Float[ndarray, "rows cols *k"]:
        """A per-vertex attribute, interpolated at the texels' centres; zero where there is no face."""
        values = np.zeros((*self.face.shape, *attribute.shape[1:]))
        covered = self.mask
        corners = attribute[faces[self.face[covered]]]
        values[covered] = np.einsum("tj,tj...->t...", self.barycentric[covered], corners)
        return values


@dataclass(frozen=True, eq=False)
class Fragments:
    """A rasterised surface: all pairs (face, texel) where the texel's centre lies in the face.

    A centre on an edge that two faces share belongs to exactly one of them: there are no gaps and no duplicates.
    Faces without area in UV have no fragments.

    Attributes:
        surface: the rasterised surface.
        rows, cols: resolution in texels.
        face, texel: indices; texel = row * cols + col.
        elevation: elevation of the face at the texel's centre.
    """

    surface: Surface
    rows: int
    cols: int
    face: Int[ndarray, " fragments"]
    texel: Int[ndarray, " fragments"]
    elevation: Float[ndarray, " fragments"]

    @classmethod
    def of(cls, surface: Surface, rows: int, cols: int) -> Fragments:
        """The fragments of all faces of a surface."""
        corners = _texel_corners(surface, rows, cols)
        found = [
            (face.astype(np.int32), texel.astype(np.int32), _elevation(surface, face, barycentric))
            for face, texel, barycentric in _fragments(corners, np.arange(len(corners)), rows, cols)
        ]
        face, texel, elevation = (np.concatenate(list(column)) for column in zip(*found, strict=True))
        return cls(surface, rows, cols, face, texel, elevation)

    def with_parts_of(self, surface: Surface) -> Fragments:
        """The same fragments for a surface that differs only in its parts: same faces, same order, same UVs."""
        return replace(self, surface=surface)

    @cached_property
    def layers(self) -> Int[ndarray, "rows cols"]:
        """Number of faces at each texel's centre."""
        return np.bincount(self.texel, minlength=self.rows * self.cols).reshape(self.rows, self.cols)

    @cached_property
    def texels_of_faces(self) -> Int[ndarray, " faces"]:
        """Number of texel centres in each face."""
        return np.bincount(self.face, minlength=len(self.surface.faces))

    @cached_property
    def top(self) -> Float[ndarray, " texels"]:
        """Elevation of the outermost face at each texel, -inf where there is none."""
        top = np.full(self.rows * self.cols, -np.inf)
        np.maximum.at(top, self.texel, self.elevation)
        return top

    def outermost(self, only: Bool[ndarray, " faces"] | None = None) -> Raster:
        """The outermost face (greatest elevation, then lowest index) at each texel, among the faces in `only`."""
        chosen = slice(None) if only is None else only[self.face]
        top, best = _nothing(self.rows * self.cols)
        _put_on_top(top, best, self.face[chosen], self.texel[chosen], self.elevation[chosen])
        return _raster(_texel_corners(self.surface, self.rows, self.cols), top, best, self.rows, self.cols)


def rasterize(surface: Surface, rows: int, cols: int, only: Bool[ndarray, " faces"] | None = None) -> Raster:
    """The same as `Fragments.outermost`, but faster: it skips covered faces and stores no fragments."""
    corners, elevation = _texel_corners(surface, rows, cols), surface.elevation[surface.faces]
    return rasterize_triangles(corners, elevation, rows, cols, only)


def rasterize_triangles(
    corners: Float[ndarray, "faces 3 2"],
    elevation: Float[ndarray, "faces 3"],
    rows: int,
    cols: int,
    only: Bool[ndarray, " faces"] | None = None,
    keep: Keep | None = None,
) -> Raster:
    """The outermost of any triangles in the plane, at the points with whole coordinates (col, row).

    Args:
        corners: of each triangle, (col, row).
        elevation: at each corner.
        only: the triangles that count.
        keep: of some fragments, given by face and barycentric coordinates, which ones count.
    """
    chosen = np.arange(len(corners)) if only is None else np.flatnonzero(only)
    ceiling = elevation.max(axis=1, initial=-np.inf) + _SLACK * np.abs(elevation).max(initial=0.0)
    chosen = chosen[np.argsort(-ceiling[chosen], kind="stable")]  # outermost first, so that later faces can be culled
    top, best = _nothing(rows * cols)
    for face, texel, barycentric in _fragments(corners, chosen, rows, cols, ceiling, top):
        kept = slice(None) if keep is None else keep(face, barycentric)
        heights = np.einsum("fi,fi->f", barycentric[kept], elevation[face[kept]])
        _put_on_top(top, best, face[kept], texel[kept], heights)
    return _raster(corners, top, best, rows, cols)


def triangle_fragments(
    corners: Float[ndarray, "faces 3 2"], rows: int, cols: int
) -> tuple[Int[ndarray, " fragments"], Int[ndarray, " fragments"], Float[ndarray, "fragments 3"]]:
    """Triangle, point (row * cols + col) and barycentric coordinates wherever a whole (col, row) lies in a triangle."""
    found = list(_fragments(corners, np.arange(len(corners)), rows, cols))
    if not found:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    face, texel, barycentric = (np.concatenate(list(column)) for column in zip(*found, strict=True))
    return face, texel, barycentric


def _texel_corners(surface: Surface, rows: int, cols: int) -> Float[ndarray, "faces 3 2"]:
    """The faces' UVs in units of texels; texel centres are at integers."""
    return surface.uv[surface.faces] * (cols, rows) - 0.5


def _elevation(surface: Surface, face: Int[ndarray, " n"], barycentric: Float[ndarray, "n 3"]) -> Float[ndarray, " n"]:
    return np.einsum("fi,fi->f", barycentric, surface.elevation[surface.faces[face]])


def _nothing(texels: int) -> tuple[Float[ndarray, " texels"], Int[ndarray, " texels"]]:
    """Initial elevation (-inf) and face index (greatest integer, so that minimum works) at each texel."""
    return np.full(texels, -np.inf), np.full(texels, np.iinfo(np.int64).max)


def _put_on_top(
    top: Float[ndarray, " texels"],
    best: Int[ndarray, " texels"],
    face: Int[ndarray, " n"],
    texel: Int[ndarray, " n"],
    elevation: Float[ndarray, " n"],
) -> None:
    """Merges further fragments into the outermost elevation `top` and face `best`, in place."""
    # forget the faces that are now covered, so that the minimum below only decides between equal elevations
    best[texel[elevation > top[texel]]] = np.iinfo(best.dtype).max
    np.maximum.at(top, texel, elevation)
    wins = elevation == top[texel]
    np.minimum.at(best, texel[wins], face[wins].astype(best.dtype))


def _raster(
    corners: Float[ndarray, "faces 3 2"],
    top: Float[ndarray, " texels"],
    best: Int[ndarray, " texels"],
    rows: int,
    cols: int,
) -> Raster:
    used = np.flatnonzero(top > -np.inf)
    row, col = np.divmod(used, cols)
    barycentric = np.zeros((rows * cols, 3))
    barycentric[used] = _covered(corners, best[used], col, row)[1]
    face = np.where(top > -np.inf, best, -1)
    return Raster(face.reshape(rows, cols), barycentric.reshape(rows, cols, 3), top.reshape(rows, cols))


def _fragments(
    corners: Float[ndarray, "faces 3 2"],
    chosen: Int[ndarray, " chosen"],
    rows: int,
    cols: int,
    ceiling: Float[ndarray, " faces"] | None = None,
    top: Float[ndarray, " texels"] | None = None,
) -> Iterator[tuple[Int[ndarray, " n"], Int[ndarray, " n"], Float[ndarray, "n 3"]]]:
    """Face, texel and barycentric coordinates of all fragments of the chosen faces, in batches of bounded size.

    Args:
        ceiling: an upper bound on the elevation of each face. With `top`, it culls fragments that are covered.
        top: outermost elevation so far. The caller may update it between batches.
    """
    low = np.clip(np.ceil(corners[chosen].min(axis=1)), 0, (cols, rows)).astype(np.int64)
    high = np.clip(np.floor(corners[chosen].max(axis=1)) + 1, low, (cols, rows)).astype(np.int64)
    total = np.cumsum(np.prod(high - low, axis=1))
    start = 0
    while start < len(chosen):
        done = total[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(total, done + _CANDIDATES_AT_ONCE, side="right")))
        index = np.arange(start, stop)
        if ceiling is not None and top is not None:
            floors = _block_floors(top, rows, cols)
            index = index[_reaches(floors, low[index], high[index], ceiling[chosen[index]])]
        within, row = ranges(low[index, 1], (high - low)[index, 1])
        line, col = ranges(low[index, 0][within], (high - low)[index, 0][within])
        local, row = within[line], row[line]
        face = chosen[index[local]]
        if ceiling is not None and top is not None:
            open_ = np.flatnonzero(top[row * cols + col] <= ceiling[face])
            local, face, row, col = local[open_], face[open_], row[open_], col[open_]
        inside, barycentric = _covered(corners[chosen[index]], local, col, row)
        yield face[inside], (row * cols + col)[inside], barycentric[inside]
        start = stop


def _block_floors(top: Float[ndarray, " texels"], rows: int, cols: int) -> Float[ndarray, "block_rows block_cols"]:
    """The least outermost elevation in each block of texels."""
    tall, wide = -(-rows // _BLOCK), -(-cols // _BLOCK)
    padded = np.full((tall * _BLOCK, wide * _BLOCK), np.inf)
    padded[:rows, :cols] = top.reshape(rows, cols)
    # whole rows first: a minimum over few neighbours in memory is slow, and this leaves an eighth to it
    return padded.reshape(tall, _BLOCK, -1).min(axis=1).reshape(tall, wide, _BLOCK).min(axis=2)


def _reaches(
    floors: Float[ndarray, "block_rows block_cols"],
    low: Int[ndarray, "n 2"],
    high: Int[ndarray, "n 2"],
    ceiling: Float[ndarray, " n"],
) -> Bool[ndarray, " n"]:
    """False for faces that have no texels or are surely covered, given their boxes of texels (`high` excluded).

    The test is conservative: boxes over more than 2 x 2 blocks of texels always give True.
    """
    first, last = low // _BLOCK, np.maximum(high - 1, low) // _BLOCK
    last = np.minimum(last, np.array(floors.shape)[::-1] - 1)
    first = np.minimum(first, last)
    large = (last - first > 1).any(axis=1)
    floor = np.min([floors[r[:, 1], c[:, 0]] for r in (first, last) for c in (first, last)], axis=0)
    return (high > low).all(axis=1) & (large | (floor <= ceiling))


def _edges(corners: Float[ndarray, "faces 3 2"]) -> Float[ndarray, "3 5 faces"]:
    """The lexicographically lower end of each edge, the vector to its other end, and the face's direction (1 or -1).

    Both faces at an edge compute a point's side from the same end, so their results are exactly opposite.
    """
    a, b = np.moveaxis(corners[:, [1, 2, 0]], 0, -1), np.moveaxis(corners[:, [2, 0, 1]], 0, -1)
    forward = (a[:, 0] < b[:, 0]) | ((a[:, 0] == b[:, 0]) & (a[:, 1] < b[:, 1]))
    low, high = np.where(forward[:, None], a, b), np.where(forward[:, None], b, a)
    return np.concatenate([low, high - low, np.where(forward, 1.0, -1.0)[:, None]], axis=1)


def _covered(
    corners: Float[ndarray, "faces 3 2"], face: Int[ndarray, " n"], col: Int[ndarray, " n"], row: Int[ndarray, " n"]
) -> tuple[Bool[ndarray, " n"], Float[ndarray, "n 3"]]:
    """Whether each face contains its point (col, row), and the point's barycentric coordinates in it."""
    sides, forward = [], []
    for edge in _edges(corners):
        x, y, along_x, along_y, sign = (values.take(face) for values in edge)
        # twice the area of the triangle of edge and point
        sides.append(sign * (along_x * (row - y) - along_y * (col - x)))
        forward.append(sign > 0)
    area = sides[0] + sides[1] + sides[2]
    left = area > 0
    inside = area != 0
    for side, runs in zip(sides, forward, strict=True):
        # tie rule: a point on an edge belongs to the one face whose winding agrees with the edge's direction
        inside &= np.where(side == 0, runs == left, (side > 0) == left)
    return inside, np.stack(sides, axis=1) / np.where(area != 0, area, 1.0)[:, None]
