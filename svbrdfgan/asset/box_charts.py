"""Charts by direction: faces that look the same way, of six, seen along that axis. Quick on millions of faces."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse import coo_matrix, csr_matrix

from svbrdfgan.asset.islands import components, edge_neighbours, welded

_SMOOTHINGS = 12  # rounds in which normals become the mean of their neighbours': noise must not make confetti
_ROUNDS = 6  # in which small charts join a neighbour
_SMALL = 64  # faces of a chart that is small
_STEEPEST = 0.3  # least cosine between a face's normal and the axis along which it is seen

_AXES = np.concatenate([np.eye(3), -np.eye(3)])
_ACROSS = np.array([[[0, 0, -1], [0, 1, 0]], [[1, 0, 0], [0, 0, -1]], [[1, 0, 0], [0, 1, 0]]], dtype=float)
_PLANES = np.concatenate([_ACROSS, _ACROSS * [[[-1.0], [1.0]], [[1.0], [-1.0]], [[-1.0], [1.0]]]])


def box_charts(positions: Float[ndarray, "faces 3 3"]) -> tuple[Float[ndarray, "faces 3 2"], Int[ndarray, " faces"]]:
    """Faces seen along the axis that is nearest to their normal, and the chart of each face.

    Areas shrink to no less than 0.3 of those in space, and on smooth surfaces to no less than 0.58.
    """
    normal = np.cross(positions[:, 1] - positions[:, 0], positions[:, 2] - positions[:, 0])
    one, other = edge_neighbours(welded(positions))
    ahead = np.einsum("fx,fx->f", normal[one], normal[other]) > 0.0
    one, other = one[ahead], other[ahead]  # not around sharp corners, and not to the back of a sheet
    ones = np.ones(2 * len(one))
    ends = (np.concatenate([one, other]), np.concatenate([other, one]))
    graph = coo_matrix((ones, ends), shape=(len(normal), len(normal))).tocsr()
    unit = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    seen = unit @ _AXES.T >= _STEEPEST
    axis = np.argmax(np.where(seen, _smoothed(normal, graph) @ _AXES.T, -np.inf), axis=1)
    for _ in range(_ROUNDS):
        axis = _joined(axis, seen, graph, (one, other))
    flat = np.einsum("fax,fcx->fca", _PLANES[axis], positions)
    same = axis[one] == axis[other]
    return flat, components(len(axis), one[same], other[same])


def _smoothed(normal: Float[ndarray, "faces 3"], graph: csr_matrix) -> Float[ndarray, "faces 3"]:
    for _ in range(_SMOOTHINGS):
        normal = normal + graph @ normal
        normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return normal


def _joined(
    axis: Int[ndarray, " faces"],
    seen: Bool[ndarray, "faces 6"],
    graph: csr_matrix,
    pairs: tuple[Int[ndarray, " pairs"], Int[ndarray, " pairs"]],
) -> Int[ndarray, " faces"]:
    """The axes, after faces of small charts took that of most of their neighbours, if they can be seen along it."""
    same = axis[pairs[0]] == axis[pairs[1]]
    chart = components(len(axis), pairs[0][same], pairs[1][same])
    large = np.bincount(chart)[chart] >= _SMALL
    votes = graph @ (np.eye(6)[axis] * np.where(large, 8.0, 1.0)[:, None])
    votes[~seen] = 0.0
    moves = ~large & (votes.max(axis=1) > 0.0)
    return np.where(moves, votes.argmax(axis=1), axis)
