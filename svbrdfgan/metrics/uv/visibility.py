"""The part of a surface that is visible from outside, found by rays. The metrics count nothing else.

The rule: a place is outside if it sees past the whole surface, at more than a grazing angle, in at least two of 64
directions spread evenly over the upper half of the sphere, the horizon included: what a camera on the ground, or
above it, sees from afar. Layers closer together than a thousandth of the model's diagonal hide nothing from each
other. The surface is cut into pieces of a fiftieth of the diagonal, and each is seen or not as its middle is.
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
_AT_ONCE = 2  # directions, each in a thread: NumPy's loops run side by side
SEEN = 2  # directions that a place must be seen from
NEAR = 1e-3  # of the diagonal: layers that hide nothing from each other
_PIECE = 0.02  # of the diagonal: the longest edge of a piece
_ROUNDS = 16
_GRAZING = 0.1  # cosine
_CLEARLY = 8  # directions that settle which side is outside


@dataclass(frozen=True, eq=False)
class VisibleSurface:
    """The triangles of a surface that count, wound counter-clockwise as seen from outside.

    Attributes:
        positions: vertices in metres, welded: neighbours in space share them.
        faces: vertex indices.
        uv: at each face's corners.
        bounds: lower and upper corner of the box around the whole surface, metres.
        repeat: whether the square's borders meet, in u and in v.
        source: face of the surface that each lies in.
        kept: share of what is seen from outside that is here; the rest lies in hidden parts.
        seen: share of the whole surface's area that is seen from outside, hidden parts included.
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
        """Square metres."""
        return face_areas(self.positions, self.faces)

    @property
    def uv_areas(self) -> Float[ndarray, " faces"]:
        """Areas in the unit square; negative where the map is mirrored, seen from outside."""
        return uv_areas(self.uv)

    @property
    def diagonal(self) -> float:
        """Of the box around the whole surface, metres."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]))

    def uv_distance(self, one: Float[ndarray, "*n 2"], other: Float[ndarray, "*n 2"]) -> Float[ndarray, " *n"]:
        """How far apart places are in the unit square, around its borders where these meet."""
        apart = np.abs(one - other)
        return np.linalg.norm(np.where(self.repeat, np.minimum(apart, 1.0 - apart), apart), axis=-1)


def whole_surface(surface: Surface) -> VisibleSurface:
    """All of a surface, as wound, hidden parts and all: for one that has nothing to hide, such as a wrap."""
    positions, faces = _welded(surface)
    return VisibleSurface(
        positions, faces, surface.uv[surface.faces], _bounds(surface), surface.repeat, np.arange(len(faces))
    )


def visible_surface(surface: Surface) -> VisibleSurface:
    """What is seen of a surface from outside and not in a hidden part; by the rule of this module. Some seconds.

    Empty if nothing is seen.
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
    """How many directions see the middle of each piece on its front, and on its back, past the occluders.

    The count ends once the front is settled to be outside.
    """
    points, normals = pieces.positions[pieces.faces].mean(axis=1), face_normals(pieces.positions, pieces.faces)
    front, back = np.zeros(len(points), dtype=np.int64), np.zeros(len(points), dtype=np.int64)
    with ThreadPoolExecutor(_AT_ONCE) as threads:
        for frames in np.array_split(upper_frames(_mixed(DIRECTIONS)), DIRECTIONS // _AT_ONCE):
            open_ = np.flatnonzero(front < _CLEARLY)
            look = partial(_facing, corners, points[open_], normals[open_], near)
            for facing in threads.map(look, frames):
                counts = front[open_] < _CLEARLY  # a direction beside this one may have settled it
                front[open_] += counts & (facing > 0)
                back[open_] += counts & (facing < 0)
    return front, back


def _facing(
    corners: Float[ndarray, "occluders 3 3"],
    points: Float[ndarray, "points 3"],
    normals: Float[ndarray, "points 3"],
    near: float,
    frame: Float[ndarray, "3 3"],
) -> Int[ndarray, " points"]:
    """1 where a direction (the frame's last row) sees a point's front, -1 its back, 0 where it does not see it."""
    cosine = normals @ frame[2]
    asked = np.flatnonzero(np.abs(cosine) > _GRAZING)
    turned, from_here = _turned(corners.reshape(-1, 3), frame).reshape(corners.shape), _turned(points[asked], frame)
    height = turned[:, :, 2]
    locator = PointLocator.of(turned[:, :, :2], ranked=np.argsort(-height.max(axis=1)))
    free = ~locator.any_higher(from_here[:, :2], from_here[:, 2] + near, height)
    facing = np.zeros(len(points), dtype=np.int64)
    facing[asked[free]] = np.sign(cosine[asked[free]])
    return facing


def _turned(points: Float[ndarray, "points 3"], frame: Float[ndarray, "3 3"]) -> Float[ndarray, "points 3"]:
    """The points in the frame. Not by BLAS, whose threads cost more than they save on three columns."""
    return np.einsum("yx,px->py", frame, points)


def _mixed(count: int) -> Int[ndarray, " count"]:
    """The numbers below `count`, by golden-ratio steps: the first few are from everywhere."""
    return np.argsort((np.arange(count) * 0.6180339887498949) % 1.0)


def _source_corners(surface: Surface) -> Float[ndarray, "source_faces 3 3"]:
    """The corners of the mesh's faces, from the largest piece of each: fewer and larger triangles than the pieces."""
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
    def wanted(
        pieces: Pieces, edges: Int[ndarray, "edges 2"], face_edges: Int[ndarray, "faces 3"]
    ) -> Bool[ndarray, " edges"]:
        ends = pieces.positions[edges]
        return np.asarray(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > length)

    return wanted
