"""The part of a surface that is visible from outside, found by ray casting. The metrics measure only this part.

A place is visible if rays from it leave the model unoccluded, at more than a grazing angle, in at least two of 64
directions. The directions are spread evenly over the upper hemisphere: they are those of distant cameras at or above
the horizon. Layers closer together than a thousandth of the model's diagonal do not occlude each other. The surface is
cut into pieces with edges of at most a fiftieth of the diagonal; the centroid decides whether a piece is visible.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import face_areas, face_normals, uv_areas
from svbrdfgan.geometry.sampling import upper_frames
from svbrdfgan.geometry.subdivide import EdgePredicate, Pieces, refine
from svbrdfgan.metrics.uv.point_location import PointLocator
from svbrdfgan.types import Surface

DIRECTIONS = 64
_AT_ONCE = 2  # directions in parallel, one per thread (NumPy releases the GIL)
SEEN = 2  # minimum number of directions from which a place must be visible
NEAR = 1e-3  # of the diagonal: layers closer than this do not occlude each other
_PIECE = 0.02  # of the diagonal: longest edge of a piece
_ROUNDS = 16
_GRAZING = 0.1  # cosine between ray and normal below which a ray does not count
_CLEARLY = 8  # directions that see the front, after which a piece needs no more rays


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """The measured triangles of a surface, counter-clockwise as seen from outside.

    Attributes:
        positions: vertices in metres, welded: adjacent faces share them.
        faces: vertex indices.
        uv: UVs of each face's corners.
        bounds: lower and upper corner of the box around the whole surface, metres.
        repeat: whether the UV square wraps around, in u and in v.
        source: source face of each triangle in the surface.
        kept: share of the visible area that is included; the rest lies in hidden parts.
        seen: share of the whole surface's area that is visible from outside, hidden parts included.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    uv: Float[ndarray, "faces 3 2"]
    bounds: Float[ndarray, "2 3"]
    repeat: tuple[bool, bool]
    source: Int[ndarray, " faces"]
    kept: float = 1.0
    seen: float = 1.0

    @property
    def areas(self) -> Float[ndarray, " faces"]:
        """Areas in square metres."""
        return face_areas(self.positions, self.faces)

    @property
    def uv_areas(self) -> Float[ndarray, " faces"]:
        """Signed areas in the unit square; negative where the map is mirrored as seen from outside."""
        return uv_areas(self.uv)

    @property
    def diagonal(self) -> float:
        """Diagonal of the whole surface's bounding box, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    def uv_distance(self, one: Float[ndarray, "*n 2"], other: Float[ndarray, "*n 2"]) -> Float[ndarray, " *n"]:
        """Distance in the unit square; across its borders if the square wraps around (`repeat`)."""
        apart = np.abs(one - other)
        return np.linalg.norm(np.where(self.repeat, np.minimum(apart, 1.0 - apart), apart), axis=-1)


def whole_surface(surface: Surface) -> VisibleSurface:
    """The whole surface with its own winding, hidden parts included; for surfaces without inner layers (wraps)."""
    positions, faces = _welded(surface)
    return VisibleSurface(
        positions, faces, surface.uv[surface.faces], _bounds(surface), surface.repeat, np.arange(len(faces))
    )


def visible_surface(surface: Surface) -> VisibleSurface:
    """The part of a surface that is visible from outside (see this module) and not in a hidden part.

    It is empty if nothing is visible. This takes seconds.
    """
    every = whole_surface(surface)
    pieces = refine(Pieces.whole(every.positions, every.faces), _longer_than(_PIECE * every.diagonal), _ROUNDS)
    front, back = _seen_from(_source_corners(surface), pieces, NEAR * every.diagonal)
    seen, turned = front + back >= SEEN, back > 4 * front
    hidden = np.array([part.hidden for part in surface.parts])[surface.face_part][pieces.source_face]
    area = face_areas(pieces.positions, pieces.faces)
    order = np.where(turned[:, None], [0, 2, 1], [0, 1, 2])
    counts = seen & ~hidden & (area > 0.0)
    return VisibleSurface(
        positions=pieces.positions,
        faces=np.take_along_axis(pieces.faces, order, axis=1)[counts],
        uv=np.take_along_axis(pieces.interpolate(every.uv), order[:, :, None], axis=1)[counts],
        bounds=every.bounds,
        repeat=surface.repeat,
        source=pieces.source_face[counts],
        kept=float(area[counts].sum() / max(area[seen].sum(), 1e-300)),
        seen=float(area[seen].sum() / max(area.sum(), 1e-300)),
    )


def _seen_from(
    corners: Float[ndarray, "occluders 3 3"], pieces: Pieces, near: float
) -> tuple[Int[ndarray, " pieces"], Int[ndarray, " pieces"]]:
    """The numbers of directions from which each piece's centroid is visible on its front and on its back.

    Counting ends for a piece when `_CLEARLY` directions see its front.
    """
    points = np.ascontiguousarray(pieces.positions[pieces.faces].mean(axis=1).T)
    normals = np.ascontiguousarray(face_normals(pieces.positions, pieces.faces).T)
    occluders = np.ascontiguousarray(corners.T)
    front, back = np.zeros(len(pieces.faces), dtype=np.int64), np.zeros(len(pieces.faces), dtype=np.int64)
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        for frames in np.array_split(upper_frames(_mixed(DIRECTIONS)), DIRECTIONS // _AT_ONCE):
            open_ = np.flatnonzero(front < _CLEARLY)
            look = partial(_facing, occluders, points[:, open_], normals[:, open_], near)
            for facing in threads.map(look, frames):
                counts = front[open_] < _CLEARLY  # another direction of this batch may have ended the count
                front[open_] += counts & (facing > 0)
                back[open_] += counts & (facing < 0)
    return front, back


def _facing(
    corners: Float[ndarray, "3 3 occluders"],
    points: Float[ndarray, "3 points"],
    normals: Float[ndarray, "3 points"],
    near: float,
    frame: Float[ndarray, "3 3"],
) -> Int[ndarray, " points"]:
    """1 if the point's front is visible from the direction (the frame's last row), -1 if its back is, 0 if neither.

    Coordinates are in the first axis: arrays of a coordinate without gaps are turned in a sixth of the time.
    """
    cosine = frame[2] @ normals
    asked = np.flatnonzero(np.abs(cosine) > _GRAZING)
    turned, from_here = _turned(corners, frame).T, _turned(points[:, asked], frame)
    height = turned[:, :, 2]
    locator = PointLocator.of(turned[:, :, :2], ranked=np.argsort(-height.max(axis=1)))
    free = ~locator.any_higher(from_here[:2].T, from_here[2] + near, height)
    facing = np.zeros(len(cosine), dtype=np.int64)
    facing[asked[free]] = np.sign(cosine[asked[free]])
    return facing


def _turned(points: Float[ndarray, " 3 *points"], frame: Float[ndarray, "3 3"]) -> Float[ndarray, " 3 *points"]:
    """The points in the frame. einsum avoids BLAS, whose threads cost more than they save on three columns."""
    return np.einsum("yx,x...->y...", frame, points)


def _mixed(count: int) -> Int[ndarray, " count"]:
    """The numbers below `count` in golden-ratio order: any first few of them are spread over the whole range."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0)


def _source_corners(surface: Surface) -> Float[ndarray, "source_faces 3 3"]:
    """The corners of the source mesh's faces, as occluders: these are fewer triangles than the surface's pieces.

    Each face is reconstructed from its largest piece.
    """
    share = np.abs(np.linalg.det(surface.source_barycentric))
    order = np.lexsort((share, surface.source_face))
    largest = order[np.diff(surface.source_face[order], append=-1) != 0]
    largest = largest[share[largest] > 1e-9]
    return np.linalg.solve(surface.source_barycentric[largest], surface.positions[surface.faces[largest]])


def _welded(surface: Surface) -> tuple[Float[ndarray, "vertices 3"], Int[ndarray, "faces 3"]]:
    positions, weld = np.unique(surface.positions, axis=0, return_inverse=True)
    return positions, weld.reshape(-1)[surface.faces]


def _bounds(surface: Surface) -> Float[ndarray, "2 3"]:
    used = surface.positions[surface.faces]
    return np.stack([used.min(axis=(0, 1)), used.max(axis=(0, 1))])


def _longer_than(length: float) -> EdgePredicate:
    """Marks edges longer than `length` metres."""

    def wanted(
        pieces: Pieces, edges: Int[ndarray, "edges 2"], face_edges: Int[ndarray, "faces 3"]
    ) -> Bool[ndarray, " edges"]:
        ends = pieces.positions[edges]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > length)

    return wanted
