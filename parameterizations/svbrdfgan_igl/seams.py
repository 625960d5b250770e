"""Cuts a surface open to a disk, and then along further seams that lower its stretch.

A further seam is the shortest path from the place of greatest stretch to the border (Gu, Gortler and Hoppe 2002).
"""

from __future__ import annotations

from dataclasses import dataclass

import igl
import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from svbrdfgan.errors import EmbeddingError
from svbrdfgan_igl.topology import Disk, euler

Edges = Int[ndarray, "edges 2"]


@dataclass(frozen=True, eq=False)
class SurfaceGraph:
    """A manifold surface as a graph.

    Attributes:
        links: symmetric adjacency matrix of the vertices; its values are the lengths of the edges.
        edges: every undirected edge once, the lower vertex index first.
        sides: the two faces at each edge; the second is -1 at a border edge.
        loops: the vertices of each border loop, in order.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    links: sparse.csr_matrix
    edges: Edges
    sides: Int[ndarray, "edges 2"]
    loops: tuple[Int[ndarray, " loop"], ...]

    @classmethod
    def of(cls, positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> SurfaceGraph:
        """The graph of a manifold surface; vertices that no face uses have no edges."""
        pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
        edges, first, inverse, count = np.unique(
            pairs, axis=0, return_index=True, return_inverse=True, return_counts=True
        )
        sides = np.full((len(edges), 2), -1)
        sides[:, 0] = first // 3
        last = np.zeros(len(edges), dtype=np.int64)
        last[inverse.reshape(-1)] = np.arange(len(pairs)) // 3
        sides[count == 2, 1] = last[count == 2]
        length = np.linalg.norm(positions[edges[:, 0]] - positions[edges[:, 1]], axis=1)
        row, col = np.concatenate([edges, edges[:, ::-1]]).T
        links = sparse.csr_matrix((np.tile(length, 2), (row, col)), shape=(len(positions),) * 2)
        loops = (
            tuple(np.asarray(loop, dtype=np.int64) for loop in igl.boundary_loop_all(faces))
            if (count == 1).any()
            else ()
        )
        return cls(positions, faces, links, edges, sides, loops)

    @property
    def handles(self) -> int:
        """The genus."""
        return (2 - len(self.loops) - euler(self.faces)) // 2

    def path(self, sources: Int[ndarray, " sources"], targets: Int[ndarray, " targets"]) -> Int[ndarray, " path"]:
        """The vertices of the shortest path from any source to any target."""
        distance, before, _ = dijkstra(self.links, indices=sources, min_only=True, return_predecessors=True)
        return _back(before, int(targets[np.argmin(distance[targets])]))


def opening(net: SurfaceGraph) -> Edges:
    """The edges to cut so that a connected surface becomes a disk; no edges if it is a disk already.

    A sphere (no border and no handle) is cut along two edges at its lowest vertex.
    """
    cut = _handles_open(net)
    if not net.loops and not len(cut):
        return _slit(net)
    reached = np.unique(cut) if len(cut) else net.loops[0]
    waiting = list(net.loops if len(cut) else net.loops[1:])
    pieces = [cut]
    while waiting:
        waiting = [loop for loop in waiting if not np.isin(loop, reached).any()] if len(cut) else waiting
        if not waiting:
            break
        path = net.path(reached, np.concatenate(waiting))
        met = next(k for k, loop in enumerate(waiting) if path[0] in loop)
        reached = np.union1d(np.union1d(reached, path), waiting.pop(met))
        pieces.append(_steps(path))
    return np.concatenate(pieces)


def cut_open(net: SurfaceGraph, cut: Edges) -> tuple[Disk, Int[ndarray, " vertices"]]:
    """The surface cut along edges, and for each of its vertices the vertex of `net` that it copies.

    Raises:
        EmbeddingError: the cut surface is not a disk.
    """
    if not len(cut):
        return Disk(net.positions, net.faces), np.arange(len(net.positions))
    count = len(net.positions)
    keys = np.sort(cut, axis=1) @ np.array([count, 1])
    corner = np.sort(np.stack([net.faces, np.roll(net.faces, -1, axis=1)], axis=2), axis=2)
    flags = np.isin(corner @ np.array([count, 1]), keys)
    positions, faces, source = igl.cut_mesh(net.positions, net.faces, flags)
    disk = Disk(np.ascontiguousarray(positions), np.asarray(faces, dtype=np.int64))
    if not disk.is_disk:
        raise EmbeddingError(
            f"the mesh, with {net.handles} handles and {len(net.loops)} holes, was not cut to a disk; close its holes "
            "or use 'hemispherical'."
        )
    return disk, np.asarray(source, dtype=np.int64).ravel()


def branch(net: SurfaceGraph, cut: Edges, vertex: int) -> Edges:
    """The cut, extended by the shortest path from a vertex to the cut or to the border."""
    reached = np.concatenate([cut.ravel(), *net.loops]).astype(np.int64)
    return np.concatenate([cut, _steps(net.path(np.unique(reached), np.array([vertex])))])


def _slit(net: SurfaceGraph) -> Edges:
    """The two edges at the lowest vertex that point most nearly in opposite directions."""
    # rounded, so that the choice among equals does not depend on the last bits of the coordinates
    low = int(np.lexsort(np.round(net.positions[:, [0, 2, 1]], 6).T)[0])
    around = net.links.indices[net.links.indptr[low] : net.links.indptr[low + 1]]
    along = net.positions[around] - net.positions[low]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    a, b = np.unravel_index(np.argmin(np.round(along @ along.T, 6)), (len(around),) * 2)
    return np.array([[around[a], low], [low, around[b]]])


def _handles_open(net: SurfaceGraph) -> Edges:
    """A short cut graph that opens all handles, by tree and cotree (Erickson and Whittlesey 2005).

    Holes count as faces, because `opening` joins them to the cut afterwards.
    """
    if net.handles == 0:
        return np.zeros((0, 2), dtype=np.int64)
    root = int(np.lexsort(np.round(net.positions[:, [0, 2, 1]], 6).T)[0])
    distance, before = dijkstra(net.links, indices=root, return_predecessors=True)
    one, other = net.edges.T
    in_tree = (before[one] == other) | (before[other] == one)
    # length of the loop that each edge closes with the two shortest paths to the root
    loop = distance[one] + distance[other] + np.asarray(net.links[one, other]).ravel()
    left = np.flatnonzero(~in_tree)
    left = left[~_cotree(net, left, loop)]
    found = [_steps(_back(before, int(v))) for v in net.edges[left].ravel()]
    return np.unique(np.sort(np.concatenate([net.edges[left], *found]), axis=1), axis=0)


def _cotree(net: SurfaceGraph, left: Int[ndarray, " edges"], loop: Float[ndarray, " all"]) -> ndarray:
    """Marks the edges that the maximum spanning cotree crosses, so that the shortest loops remain to be cut.

    Every hole counts as a face.
    """
    hole = np.zeros(len(net.positions), dtype=np.int64)
    for k, vertices in enumerate(net.loops):
        hole[vertices] = len(net.faces) + k
    sides = net.sides[left]
    a, b = sides[:, 0], np.where(sides[:, 1] < 0, hole[net.edges[left, 0]], sides[:, 1])
    size = len(net.faces) + len(net.loops)
    order = np.argsort(-loop[left], kind="stable")
    rank = np.empty(len(left))
    rank[order] = 1.0 + np.arange(len(left))  # longest first; from 1, as scipy drops tree edges of weight 0
    low, high = np.minimum(a, b), np.maximum(a, b)
    best = np.lexsort((rank, high, low))  # two faces may share several edges: keep the edge with the longest loop
    first = np.concatenate([[True], (np.diff(low[best]) != 0) | (np.diff(high[best]) != 0)])
    best = best[first & (low[best] != high[best])]
    graph = sparse.csr_matrix((rank[best], (low[best], high[best])), shape=(size, size))
    return np.isin(rank, minimum_spanning_tree(graph).data)


def _back(before: Int[ndarray, " vertices"], vertex: int) -> Int[ndarray, " path"]:
    """The path from a vertex back to its source, by Dijkstra's predecessors."""
    path = [vertex]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return np.array(path)


def _steps(path: Int[ndarray, " path"]) -> Edges:
    """The edges between successive vertices of a path."""
    return np.stack([path[:-1], path[1:]], axis=1)
