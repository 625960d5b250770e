"""Disks, and the topology of triangle meshes: components, borders, manifoldness."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy import sparse
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True, eq=False)
class Disk:
    """A manifold surface with the topology of a disk.

    Attributes:
        positions: vertices; every one is used by a face.
        faces: counter-clockwise seen from outside.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]

    @cached_property
    def border(self) -> Int[ndarray, " loop"]:
        """The vertices around the border, in the direction in which the winding of the faces follows it."""
        return np.asarray(igl.boundary_loop(self.faces), dtype=np.int64)

    @property
    def is_disk(self) -> bool:
        """Whether the surface is manifold, connected, and has one border and no handle."""
        # an Euler characteristic of 2 - 2 * handles - borders = 1 leaves only this case
        return is_manifold(self.faces) and euler(self.faces) == 1 and components(self.faces)[0] == 1


def euler(faces: Int[ndarray, "faces 3"]) -> int:
    """The Euler characteristic: vertices - edges + faces, over the vertices that faces use."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return len(np.unique(faces)) - len(np.unique(edges, axis=0)) + len(faces)


def is_manifold(faces: Int[ndarray, "faces 3"]) -> bool:
    """Whether each directed edge occurs once (so that winding agrees), and each vertex has one fan of faces."""
    directed = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    if len(np.unique(directed, axis=0)) < len(directed) or (directed[:, 0] == directed[:, 1]).any():
        return False
    return _fans(faces) == len(np.unique(faces))


def _fans(faces: Int[ndarray, "faces 3"]) -> int:
    """The number of fans over all vertices; a fan is a set of corners at a vertex that are connected across edges."""
    count = len(faces)
    corner = np.arange(3 * count).reshape(count, 3)
    start, end = faces, np.roll(faces, -1, axis=1)
    order = np.lexsort((np.maximum(start, end).ravel(), np.minimum(start, end).ravel()))
    pair = np.stack([np.minimum(start, end).ravel(), np.maximum(start, end).ravel()], axis=1)[order]
    same = np.flatnonzero((pair[1:] == pair[:-1]).all(axis=1))
    one, other = order[same], order[same + 1]  # half-edges face * 3 + k that share an edge, in opposite directions
    after = np.roll(corner, -1, axis=1).ravel()
    row = np.concatenate([one, after[one]])
    col = np.concatenate([after[other], other])
    graph = sparse.coo_matrix((np.ones(len(row)), (row, col)), shape=(3 * count, 3 * count))
    return int(connected_components(graph, directed=False)[0])


def components(faces: Int[ndarray, "faces 3"]) -> tuple[int, Int[ndarray, " faces"]]:
    """The number of components that are connected across edges, and the component of each face."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    _, edge = np.unique(edges, axis=0, return_inverse=True)
    edge = edge.reshape(-1)
    face = np.repeat(np.arange(len(faces)), 3)
    links = sparse.coo_matrix((np.ones(len(face)), (face, edge)), shape=(len(faces), int(edge.max(initial=-1)) + 1))
    count, label = connected_components(links @ links.T, directed=False)
    return int(count), label.astype(np.int64)


def largest_component(faces: Int[ndarray, "faces 3"], chosen: Bool[ndarray, " faces"]) -> Bool[ndarray, " faces"]:
    """Marks the largest component among the chosen faces."""
    result = np.zeros(len(faces), dtype=bool)
    if chosen.any():
        _, label = components(faces[chosen])
        result[np.flatnonzero(chosen)[label == np.argmax(np.bincount(label))]] = True
    return result


def compact(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> Disk:
    """The faces over only the vertices that they use."""
    used, index = np.unique(faces, return_inverse=True)
    return Disk(positions[used], index.reshape(-1, 3).astype(np.int64))
