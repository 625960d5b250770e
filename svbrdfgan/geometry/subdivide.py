"""Subdivision of triangles at edge midpoints, without gaps; each piece knows its source face."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

# Corners 0-2 are the face's own, 3-5 the midpoints of its edges 01, 12, 20. Bit k of the key: edge k is cut.
_PATTERNS: dict[int, tuple[tuple[int, int, int], ...]] = {
    0b000: ((0, 1, 2),),
    0b001: ((0, 3, 2), (3, 1, 2)),
    0b010: ((1, 4, 0), (4, 2, 0)),
    0b100: ((2, 5, 1), (5, 0, 1)),
    0b011: ((3, 1, 4), (0, 3, 4), (0, 4, 2)),
    0b110: ((4, 2, 5), (1, 4, 5), (1, 5, 0)),
    0b101: ((5, 0, 3), (2, 5, 3), (2, 3, 1)),
    0b111: ((0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)),
}
# Barycentric coordinates of the six corners.
_LOCAL = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0], [0, 0.5, 0.5], [0.5, 0, 0.5]])


@dataclass(frozen=True, eq=False)
class Pieces:
    """Triangles cut from source triangles, which they cover exactly.

    Attributes:
        positions: vertices, the original ones first.
        faces: vertex indices, with the winding of their source faces.
        source_face: the original face of each piece.
        source_barycentric: barycentric coordinates of each piece's corners in its source face.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    source_face: Int[ndarray, " faces"]
    source_barycentric: Float[ndarray, "faces 3 3"]

    @classmethod
    def whole(cls, positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> Pieces:
        """The uncut triangles."""
        return cls(positions, faces, np.arange(len(faces)), np.broadcast_to(np.eye(3), (len(faces), 3, 3)).copy())

    def interpolate(self, attribute: Float[ndarray, "source_faces 3 *k"]) -> Float[ndarray, "faces 3 *k"]:
        """A per-corner attribute of the original faces, interpolated at the corners of the pieces."""
        return np.einsum("fij,fj...->fi...", self.source_barycentric, attribute[self.source_face])


EdgePredicate = Callable[[Pieces, Int[ndarray, "edges 2"], Int[ndarray, "faces 3"]], Bool[ndarray, " edges"]]
"""Marks the edges to cut, given pieces, their edges, and the edge indices of each face's sides 01, 12, 20."""


def unique_edges(faces: Int[ndarray, "faces 3"]) -> tuple[Int[ndarray, "edges 2"], Int[ndarray, "faces 3"]]:
    """Every edge once, lower vertex first, and the edge indices of each face's sides 01, 12, 20."""
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    count = int(faces.max()) + 1
    keys, inverse = np.unique(pairs[:, 0] * count + pairs[:, 1], return_inverse=True)
    return np.stack(np.divmod(keys, count), axis=1), inverse.reshape(-1, 3)


def refine(pieces: Pieces, wanted: EdgePredicate, rounds: int) -> Pieces:
    """The pieces, cut repeatedly until `wanted` marks no edges or `rounds` is reached."""
    for _ in range(rounds):
        edges, face_edges = unique_edges(pieces.faces)
        cut = wanted(pieces, edges, face_edges)
        if not cut.any():
            break
        pieces = cut_edges(pieces, edges, face_edges, cut)
    return pieces


def cut_edges(
    pieces: Pieces,
    edges: Int[ndarray, "edges 2"],
    face_edges: Int[ndarray, "faces 3"],
    cut: Bool[ndarray, " edges"],
) -> Pieces:
    """The pieces with the chosen edges cut at their midpoints in all faces at them, so there are no T-junctions."""
    midpoint = len(pieces.positions) - 1 + np.cumsum(cut)
    positions = np.concatenate([pieces.positions, pieces.positions[edges[cut]].mean(axis=1)])
    six = np.concatenate([pieces.faces, midpoint[face_edges]], axis=1)
    pattern = cut[face_edges] @ np.array([1, 2, 4])
    faces, sources, barycentric = [], [], []
    for key, triangles in _PATTERNS.items():
        chosen = np.flatnonzero(pattern == key)
        for triangle in map(list, triangles):
            faces.append(six[chosen][:, triangle])
            sources.append(pieces.source_face[chosen])
            barycentric.append(np.einsum("ij,fjk->fik", _LOCAL[triangle], pieces.source_barycentric[chosen]))
    return Pieces(positions, np.concatenate(faces), np.concatenate(sources), np.concatenate(barycentric))
