"""Convert per-corner attributes to vertices, one for each distinct combination, as in a GPU vertex buffer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import corner_normals, unit
from svbrdfgan.geometry.subdivide import Pieces, cut_edges, unique_edges
from svbrdfgan.types import Mesh, Part, Surface

_STEPS = 1 << 24  # attributes are compared after rounding to multiples of 1 / _STEPS


def split_corners(
    faces: Int[ndarray, "faces 3"], face_part: Int[ndarray, " faces"], *attributes: Float[ndarray, "faces 3 _"]
) -> tuple[Int[ndarray, " vertices"], Int[ndarray, "faces 3"]]:
    """The corners (face * 3 + k) that become vertices, and the faces over these vertices.

    Corners share a vertex if they have the same position index, part and attributes (of magnitude about 1).
    """
    columns = [faces.reshape(-1, 1), np.repeat(face_part, 3)[:, None]]
    columns += [np.round(a.reshape(faces.size, -1) * _STEPS).astype(np.int64) for a in attributes]
    keys = np.concatenate(columns, axis=1).T
    order = np.lexsort(keys[::-1])
    fresh = (np.diff(keys[:, order], prepend=-1) != 0).any(axis=0)  # no position has index -1: the first is fresh
    vertex = np.empty_like(order)
    vertex[order] = np.cumsum(fresh) - 1
    return order[fresh], vertex.reshape(-1, 3)


def surface_over(
    mesh: Mesh,
    uv: Float[ndarray, "faces 3 2"],
    distinct: Float[ndarray, "faces 3 _"] | None = None,
    normals: Float[ndarray, "faces 3 3"] | None = None,
) -> Surface:
    """The mesh as it is, over UVs that may leave the unit square.

    Args:
        distinct: what corners of one vertex must have in common, besides position, normal and part; by default `uv`.
        normals: at face corners, unit; by default the mesh's own, which take as long as all else.
    """
    if normals is None:
        normals = corner_normals(mesh.positions, mesh.faces)
    corner, faces = split_corners(mesh.faces, mesh.face_part, normals, uv if distinct is None else distinct)
    return Surface(
        positions=mesh.positions[mesh.faces.ravel()[corner]],
        normals=normals.reshape(-1, 3)[corner],
        uv=uv.reshape(-1, 2)[corner],
        faces=faces,
        face_part=mesh.face_part,
        parts=mesh.parts,
        elevation=np.zeros(len(corner)),
        source_face=np.arange(len(faces)),
        source_barycentric=np.tile(np.eye(3), (len(faces), 1, 1)),
    )


def surface_from_corners(
    pieces: Pieces,
    *,
    normals: Float[ndarray, "faces 3 3"],
    uv: Float[ndarray, "faces 3 2"],
    elevation: Float[ndarray, "faces 3"],
    face_part: Int[ndarray, " faces"],
    parts: tuple[Part, ...],
    repeat: tuple[bool, bool] = (False, False),
) -> Surface:
    """The surface of these pieces. Vertices are split where normal, uv or part differ; normals are normalised."""
    normals = unit(normals)
    corner, faces = split_corners(pieces.faces, face_part, normals, uv)
    return Surface(
        positions=pieces.positions[pieces.faces.ravel()[corner]],
        normals=normals.reshape(-1, 3)[corner],
        uv=np.clip(uv.reshape(-1, 2)[corner], 0.0, 1.0),
        faces=faces,
        face_part=face_part,
        parts=parts,
        elevation=elevation.ravel()[corner],
        source_face=pieces.source_face,
        source_barycentric=pieces.source_barycentric,
        repeat=repeat,
    )


def cut_faces(surface: Surface, chosen: Bool[ndarray, " faces"]) -> Surface:
    """The surface with each chosen face cut in four. Neighbours are cut too, so that there are no T-junctions.

    Attributes of new vertices are interpolated, so shape, UVs and shading do not change.
    """
    positions, weld = np.unique(surface.positions, axis=0, return_inverse=True)
    pieces = Pieces.whole(positions, weld.reshape(-1)[surface.faces])
    edges, face_edges = unique_edges(pieces.faces)
    cut = np.isin(np.arange(len(edges)), face_edges[chosen]) & (edges[:, 0] != edges[:, 1])
    pieces = cut_edges(pieces, edges, face_edges, cut)
    parent = pieces.source_face
    back = Pieces(
        pieces.positions, pieces.faces, surface.source_face[parent], pieces.interpolate(surface.source_barycentric)
    )
    return surface_from_corners(
        back,
        normals=pieces.interpolate(surface.normals[surface.faces]),
        uv=pieces.interpolate(surface.uv[surface.faces]),
        elevation=pieces.interpolate(surface.elevation[surface.faces]),
        face_part=surface.face_part[parent],
        parts=surface.parts,
        repeat=surface.repeat,
    )


def with_parts(surface: Surface, face_part: Int[ndarray, " faces"], parts: tuple[Part, ...]) -> Surface:
    """The surface with its faces assigned to other parts; vertices shared by different parts are split."""
    key, inverse = np.unique(surface.faces.ravel() * len(parts) + np.repeat(face_part, 3), return_inverse=True)
    vertex = key // len(parts)
    return replace(
        surface,
        positions=surface.positions[vertex],
        normals=surface.normals[vertex],
        uv=surface.uv[vertex],
        elevation=surface.elevation[vertex],
        faces=inverse.reshape(-1, 3),
        face_part=face_part,
        parts=parts,
    )
