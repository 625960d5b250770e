"""The charts of a UV map: connected faces that have the same orientation and do not overlap each other."""

from __future__ import annotations

from collections import deque

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import connected_components

from svbrdfgan.geometry.normals import uv_areas
from svbrdfgan_given.overlap import overlapping_pairs

_STEPS = 1 << 20  # UVs of corners that agree to this fraction of the square count as equal
_FLAT = 1e-12  # of the square of the longest edge: faces with less area in UV count as a line or a point


def signed_areas(uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, " faces"]:
    """Areas in UV: negative for mirrored faces, exactly zero for a face that is a line or a point."""
    area = uv_areas(uv)
    longest = np.square(uv - np.roll(uv, 1, axis=1)).sum(axis=2).max(axis=1)
    # No less than 1e-300: a face whose corners are one point in UV has no longest edge to compare with.
    return np.where(2.0 * np.abs(area) > np.maximum(_FLAT * longest, 1e-300), area, 0.0)


def find_charts(faces: Int[ndarray, "faces 3"], uv: Float[ndarray, "faces 3 2"]) -> Int[ndarray, " faces"]:
    """The chart of each face, numbered from 0; -1 for faces that are a line or a point in UV."""
    area = signed_areas(uv)
    graph = _neighbours(faces, uv, np.sign(area).astype(np.int64))
    label = connected_components(graph, directed=False)[1].astype(np.int64)
    good = area != 0.0
    label = _parted(label, good, graph, _unmirrored(uv, area))
    chart = np.full(len(faces), -1, dtype=np.int64)
    chart[good] = np.unique(label[good], return_inverse=True)[1]
    return chart


def charts_overlap(uv: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> bool:
    """Whether any two faces overlap, in one chart or in two."""
    good = chart >= 0
    corners = _unmirrored(uv[good], signed_areas(uv[good]))
    return any(len(pairs) > 0 for pairs in overlapping_pairs(corners, np.zeros(len(corners), dtype=np.int64)))


def _unmirrored(uv: Float[ndarray, "faces 3 2"], area: Float[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
    """The triangles, wound counter-clockwise."""
    return np.where((area < 0)[:, None, None], uv[:, [0, 2, 1]], uv)


def _neighbours(
    faces: Int[ndarray, "faces 3"], uv: Float[ndarray, "faces 3 2"], side: Int[ndarray, " faces"]
) -> csr_matrix:
    """Adjacency of faces that share an edge both in space and in UV, and have the same orientation."""
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    place = np.round(np.stack([uv, np.roll(uv, -1, axis=1)], axis=2).reshape(-1, 2, 2) * _STEPS).astype(np.int64)
    swap = ends[:, 0] > ends[:, 1]
    ends, place = np.where(swap[:, None], ends[:, ::-1], ends), np.where(swap[:, None, None], place[:, ::-1], place)
    owner = np.repeat(np.arange(len(faces)), 3)
    rows = np.column_stack([ends, place.reshape(-1, 4), side[owner]])
    order = np.lexsort(rows.T)
    same = (rows[order][1:] == rows[order][:-1]).all(axis=1)
    one, other = owner[order[:-1][same]], owner[order[1:][same]]
    graph = coo_matrix((np.ones(len(one), dtype=np.int8), (one, other)), shape=(len(faces), len(faces)))
    return (graph + graph.T).tocsr()


def _parted(
    label: Int[ndarray, " faces"],
    good: Bool[ndarray, " faces"],
    graph: csr_matrix,
    corners: Float[ndarray, "faces 3 2"],
) -> Int[ndarray, " faces"]:
    """The labels, after each chart that overlaps itself is cut into charts that do not."""
    index = np.flatnonzero(good)
    found = [index[pairs] for pairs in overlapping_pairs(corners[index], label[index])] if len(index) else []
    pairs = np.concatenate(found) if found else np.zeros((0, 2), dtype=np.int64)
    rivals: dict[int, set[int]] = {}
    for one, other in pairs.tolist():
        rivals.setdefault(one, set()).add(other)
        rivals.setdefault(other, set()).add(one)
    label, free = label.copy(), int(label.max(initial=0)) + 1
    for chart in np.unique(label[pairs[:, 0]]):
        left = set(np.flatnonzero(good & (label == chart)).tolist())
        while left:
            grown = _grow(min(left), left, graph, rivals)
            label[list(grown)] = free
            free += 1
            left -= grown
    return label


def _grow(seed: int, allowed: set[int], graph: csr_matrix, rivals: dict[int, set[int]]) -> set[int]:
    """The faces reached from the seed, breadth first, except those that would overlap a face reached before."""
    grown, barred, queue = {seed}, set(rivals.get(seed, ())), deque([seed])
    while queue:
        face = queue.popleft()
        for neighbour in graph.indices[graph.indptr[face] : graph.indptr[face + 1]].tolist():
            if neighbour in allowed and neighbour not in grown and neighbour not in barred:
                grown.add(neighbour)
                barred |= rivals.get(neighbour, set())
                queue.append(neighbour)
    return grown
