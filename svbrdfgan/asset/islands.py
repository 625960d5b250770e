"""Islands of a UV map: faces that share edges both in space and in UV, all wound the same way."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from svbrdfgan.io.rows import merge_rows

_STEPS = 1 << 20  # places that agree to this fraction of the extent are one
_FLAT = 1e-7  # of the square of the longest edge: faces with less area are a line or a point


def areas(positions: Float[ndarray, "faces 3 3"]) -> Float[ndarray, " faces"]:
    """Areas of triangles in space."""
    first, second = positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0]
    return 0.5 * np.linalg.norm(np.cross(first, second), axis=1)


def signed_areas(uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, " faces"]:
    """Areas in UV, negative where mirrored, and exactly zero for a face that is a line or a point."""
    first, second = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
    area = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    longest = np.square(uv - np.roll(uv, 1, axis=1)).sum(axis=2).max(axis=1, initial=0.0)
    return np.where(np.abs(area) > _FLAT * np.maximum(longest, 1e-300), area, 0.0)


def extent(positions: Float[ndarray, "faces 3 3"]) -> float:
    """Diagonal of the bounding box, at least a tiny positive number."""
    points = positions.reshape(-1, 3)
    return max(float(np.linalg.norm(np.ptp(points, axis=0))), 1e-300)


def welded(corners: Float[ndarray, "faces 3 axes"]) -> Int[ndarray, "faces 3"]:
    """Vertex numbers of corners; corners at one place have one number."""
    points = corners.reshape(-1, corners.shape[-1])
    scale = max(float(np.ptp(points, axis=0).max()), 1e-300)
    _, index = merge_rows(np.round((points - points.min(axis=0)) * (_STEPS / scale)))
    return index.reshape(-1, 3)


def find_islands(
    vertices: Int[ndarray, "faces 3"], places: Int[ndarray, "faces 3"], side: Int[ndarray, " faces"]
) -> Int[ndarray, " faces"]:
    """The island of each face, numbered from 0.

    Args:
        vertices: welded corners in space.
        places: welded corners in UV.
        side: sign of each face in UV; only faces of one sign are joined.
    """
    count = int(places.max(initial=0)) + 1
    corner = np.unique(vertices * count + places, return_inverse=True)[1].reshape(-1, 3)
    one, other = edge_neighbours(corner)
    alike = side[one] == side[other]
    return components(len(vertices), one[alike], other[alike])


def edge_neighbours(corner: Int[ndarray, "faces 3"]) -> tuple[Int[ndarray, " pairs"], Int[ndarray, " pairs"]]:
    """Pairs of faces that share an edge. Where many faces do, each is paired with the next three."""
    ends = np.sort(np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edge = ends[:, 0] * (int(corner.max(initial=0)) + 1) + ends[:, 1]
    order = np.argsort(edge, kind="stable")
    edge, owner = edge[order], np.repeat(np.arange(len(corner)), 3)[order]
    found = [(owner[:-k][edge[k:] == edge[:-k]], owner[k:][edge[k:] == edge[:-k]]) for k in (1, 2, 3)]
    one, other = (np.concatenate(side) for side in zip(*found, strict=True))
    return one, other


def components(count: int, one: Int[ndarray, " pairs"], other: Int[ndarray, " pairs"]) -> Int[ndarray, " count"]:
    """The connected component of each of `count` nodes, given the pairs that are joined."""
    graph = coo_matrix((np.ones(len(one), dtype=np.int8), (one, other)), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def uv_islands(positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"]) -> Int[ndarray, " faces"]:
    """The island of each face of a UV map, numbered from 0. Faces without area in UV join only their like."""
    return find_islands(welded(positions), welded(uv), np.sign(signed_areas(uv)).astype(np.int64))
