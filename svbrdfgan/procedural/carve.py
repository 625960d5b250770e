"""Mesh operations for procedural vehicles: cut along a curve, recess a region, weld and join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import Mesh

_SNAP = 0.22  # share of an edge: if the cut is nearer to a vertex, the vertex moves onto the cut (avoids slivers)
_SAME = 1e-6  # positions that round to the same multiple of this are merged


def weld(mesh: Mesh) -> Mesh:
    """The mesh with coincident vertices merged. Faces that lose a corner by the merge are dropped."""
    _, first, index = np.unique(
        np.round(mesh.positions / _SAME).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    faces = index.reshape(-1)[mesh.faces]
    a, b, c = faces.T
    keep = (a != b) & (b != c) & (c != a)
    return replace(mesh, positions=mesh.positions[first], faces=faces[keep], face_part=mesh.face_part[keep])


def join(meshes: Sequence[Mesh]) -> Mesh:
    """The meshes as one mesh; all of them must have the same parts."""
    offsets = np.cumsum([0, *(len(mesh.positions) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]),
        np.concatenate([mesh.face_part for mesh in meshes]),
        meshes[0].parts,
    )


def cut(mesh: Mesh, distance: Float[ndarray, " vertices"]) -> tuple[Mesh, Bool[ndarray, " faces"]]:
    """The mesh cut along the zero line of `distance` (one value per vertex), and a mask of the faces inside.

    Inside means that `distance` is negative. Vertices very near to the zero line are moved onto it along an edge.
    A closed mesh stays closed.
    """
    edges, face_edges = _edges(mesh.faces)
    positions, distance = _snapped(mesh.positions, edges, distance)
    a, b = distance[edges].T
    crossed = a * b < 0.0
    share = a[crossed] / (a[crossed] - b[crossed])
    start, end = positions[edges[crossed, 0]], positions[edges[crossed, 1]]
    new = np.full(len(edges), -1)
    new[crossed] = len(positions) + np.arange(int(crossed.sum()))
    positions = np.concatenate([positions, start + share[:, None] * (end - start)])
    distance = np.concatenate([distance, np.zeros(int(crossed.sum()))])
    faces, source = _split(mesh.faces, new[face_edges])
    inside = distance[faces].sum(axis=1) < 0.0
    return replace(mesh, positions=positions, faces=faces, face_part=mesh.face_part[source]), inside


def sink(mesh: Mesh, region: Bool[ndarray, " faces"], offset: Float[ndarray, "vertices 3"], wall: int) -> Mesh:
    """The mesh with the region's faces moved by `offset`, joined to the rest by walls of part `wall`."""
    used = np.unique(mesh.faces[region])
    moved = np.full(len(mesh.positions), -1)
    moved[used] = len(mesh.positions) + np.arange(len(used))
    corners = mesh.faces[region]
    half = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
    key = half[:, 0] * len(mesh.positions) + half[:, 1]
    # A half-edge whose opposite is not in the region lies on the region's border.
    border = half[~np.isin(half[:, 1] * len(mesh.positions) + half[:, 0], key)]
    a, b = border.T
    walls = np.concatenate([np.stack([a, b, moved[b]], axis=1), np.stack([a, moved[b], moved[a]], axis=1)])
    faces = mesh.faces.copy()
    faces[region] = moved[corners]
    return replace(
        mesh,
        positions=np.concatenate([mesh.positions, (mesh.positions + offset)[used]]),
        faces=np.concatenate([faces, walls]),
        face_part=np.concatenate([mesh.face_part, np.full(len(walls), wall)]),
    )


def vertex_normals(mesh: Mesh) -> Float[ndarray, "vertices 3"]:
    """Unit vertex normals: the area-weighted mean of the normals of all faces at each vertex."""
    a, b, c = (mesh.positions[mesh.faces[:, k]] for k in range(3))
    normals = np.zeros_like(mesh.positions)
    for k in range(3):
        np.add.at(normals, mesh.faces[:, k], np.cross(b - a, c - a))  # its length is twice the area: the weight
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-20)


def _edges(faces: Int[ndarray, "faces 3"]) -> tuple[Int[ndarray, "edges 2"], Int[ndarray, "faces 3"]]:
    """Every edge once, and the edge index of each face's sides 01, 12 and 20."""
    following = np.roll(faces, -1, axis=1)
    size = int(faces.max()) + 1
    keys, index = np.unique(np.minimum(faces, following) * size + np.maximum(faces, following), return_inverse=True)
    return np.stack([keys // size, keys % size], axis=1), index.reshape(-1, 3)


def _snapped(positions: ndarray, edges: ndarray, distance: ndarray) -> tuple[ndarray, ndarray]:
    """Positions and distances after the vertices next to the zero line have been moved onto it."""
    both = np.concatenate([edges, edges[:, ::-1]])
    near, far = distance[both].T
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(near * far < 0.0, near / (near - far), 1.0)
    order = np.argsort(-share)
    order = order[share[order] < _SNAP]  # descending: the nearest crossing is written last and wins
    start, end = both[order].T
    moved, snapped = positions.copy(), distance.copy()
    moved[start] = positions[start] + share[order, None] * (positions[end] - positions[start])
    snapped[start] = 0.0
    return moved, snapped


def _split(faces: Int[ndarray, "faces 3"], new: Int[ndarray, "faces 3"]) -> tuple[ndarray, ndarray]:
    """Faces split at the new vertices on their edges (-1: edge not cut), and the source face of each."""
    cuts = (new >= 0).sum(axis=1)
    # Rotate each face's corners: a single cut lies on its first edge; with two cuts, the uncut edge is the second.
    turn = np.where(cuts == 1, np.argmax(new >= 0, axis=1), (np.argmax(new < 0, axis=1) + 2) % 3)
    order = (turn[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, order, axis=1).T
    ab, _, ca = np.take_along_axis(new, order, axis=1).T
    groups = [
        (cuts == 0, [(a, b, c)]),
        (cuts == 1, [(a, ab, c), (ab, b, c)]),
        (cuts == 2, [(a, ab, ca), (ab, b, c), (ab, c, ca)]),
    ]
    pieces = [(np.stack(triple, axis=1)[mask], np.flatnonzero(mask)) for mask, triples in groups for triple in triples]
    return np.concatenate([p[0] for p in pieces]), np.concatenate([p[1] for p in pieces])
