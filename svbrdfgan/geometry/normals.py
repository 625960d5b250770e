"""Shading normals by the one crease-angle rule of `docs/conventions.md`, and triangle areas."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

CREASE_ANGLE = math.radians(40.0)
UP = np.array([0.0, 1.0, 0.0])
_DEGENERATE = 1e-12  # sine below which two edges of a triangle count as parallel
_NEAR = math.cos(CREASE_ANGLE) - 1e-12
_PAIRS_AT_ONCE = 1 << 21
_CROWD = 256  # corners at one vertex beyond which a product of matrices takes the place of lists of pairs


def unit(vectors: Float[ndarray, "*n 3"], fallback: Float[ndarray, "*n 3"] = UP) -> Float[ndarray, "*n 3"]:
    """The vectors scaled to length one; `fallback` (unit, broadcast) replaces vectors of (nearly) zero length."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.where(length > 1e-30, vectors / np.maximum(length, 1e-30), fallback)


def face_normals(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> Float[ndarray, "faces 3"]:
    """Unit geometric normals, by the right-hand rule; zero for degenerate faces."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    longest = np.max([np.sum((q - p) ** 2, axis=1) for p, q in ((a, b), (b, c), (c, a))], axis=0)
    good = np.linalg.norm(normal, axis=1) > _DEGENERATE * longest
    return np.where(good[:, None], unit(normal), 0.0)


def face_areas(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> Float[ndarray, " faces"]:
    """Areas in square metres."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def uv_areas(corners: Float[ndarray, "faces 3 2"]) -> Float[ndarray, " faces"]:
    """Signed areas of 2D triangles; clockwise ones are negative."""
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    return 0.5 * (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0])


def corner_angles(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> Float[ndarray, "faces 3"]:
    """The interior angle at each corner of each triangle, radians."""
    corners = positions[faces]
    onward = unit(np.roll(corners, -1, axis=1) - corners)
    back = unit(np.roll(corners, 1, axis=1) - corners)
    return np.arccos(np.clip(np.sum(onward * back, axis=2), -1.0, 1.0))


def corner_normals(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]
) -> Float[ndarray, "faces 3 3"]:
    """Unit shading normals per face corner.

    A corner's normal is the angle-weighted mean of the normals of the faces around its vertex, limited to faces within
    `CREASE_ANGLE` of the corner's own face. Vertices must be welded. Corners of degenerate faces get +Y.
    """
    flat = face_normals(positions, faces)
    weighted = (flat[:, None, :] * corner_angles(positions, faces)[:, :, None]).reshape(-1, 3)
    smooth = np.zeros((3 * len(faces), 3))
    for corner, neighbour in _corner_pairs(faces):
        near = np.einsum("ij,ij->i", flat[corner // 3], flat[neighbour // 3]) >= _NEAR
        for axis in range(3):
            smooth[:, axis] += np.bincount(corner[near], weighted[neighbour[near], axis], len(smooth))
    for around in _crowds(faces):
        smooth[around] = _smoothed(flat[around // 3], weighted[around])
    own = unit(np.repeat(flat, 3, axis=0))
    return unit(smooth, own).reshape(-1, 3, 3)


def _corner_pairs(faces: Int[ndarray, "faces 3"]) -> Iterator[tuple[Int[ndarray, " pairs"], Int[ndarray, " pairs"]]]:
    """Every ordered pair of corners at the same vertex, but those of `_crowds`, in batches of bounded size."""
    vertex = faces.ravel()
    order = np.argsort(vertex, kind="stable")
    valence = np.bincount(vertex)
    first = np.cumsum(valence) - valence
    few = np.flatnonzero(valence[vertex] <= _CROWD)
    total = np.cumsum(valence[vertex[few]])
    start = 0
    while start < len(few):
        done = total[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(total, done + _PAIRS_AT_ONCE, side="right")))
        corner = few[start:stop]
        around = valence[vertex[corner]]
        within = np.arange(around.sum()) - np.repeat(np.cumsum(around) - around, around)
        yield np.repeat(corner, around), order[np.repeat(first[vertex[corner]], around) + within]
        start = stop


def _crowds(faces: Int[ndarray, "faces 3"]) -> Iterator[Int[ndarray, " corners"]]:
    """The corners at each vertex that has so many that lists of pairs would take minutes."""
    vertex = faces.ravel()
    for crowded in np.flatnonzero(np.bincount(vertex) > _CROWD):
        yield np.flatnonzero(vertex == crowded)


def _smoothed(flat: Float[ndarray, "corners 3"], weighted: Float[ndarray, "corners 3"]) -> Float[ndarray, "corners 3"]:
    """For each corner at one vertex the sum of what is weighted, over those whose faces are near its own in angle."""
    normals, inverse = np.unique(flat, axis=0, return_inverse=True)
    which = inverse.reshape(-1)
    sums = np.stack([np.bincount(which, weighted[:, axis], len(normals)) for axis in range(3)], axis=1)
    rows = max(1, _PAIRS_AT_ONCE // len(normals))
    near = (normals[start : start + rows] @ normals.T >= _NEAR for start in range(0, len(normals), rows))
    return np.concatenate([each.astype(np.float64) @ sums for each in near])[which]
