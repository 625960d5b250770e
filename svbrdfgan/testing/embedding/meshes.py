"""Meshes for the tests: ordinary ones, whose surfaces are examined, and awkward ones like those in users' files.

Each call makes a new mesh, so that an embedding that writes into a mesh does not affect other tests. All meshes have
one-to-one, unmirrored UVs, for embeddings that keep the mesh's own UVs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import Mesh, Part

_SIDES = 6
_METRES = (0.9, 0.7, 2.1)  # half the width, height and length of `body`


def mesh_of(
    positions: Float[ndarray, "vertices 3"],
    faces: Int[ndarray, "faces 3"],
    face_part: Int[ndarray, " faces"] | None = None,
) -> Mesh:
    """A mesh with a UV triangle of its own for each face, and as many parts as `face_part` names."""
    positions, faces = np.array(positions, dtype=np.float64), np.array(faces, dtype=np.int64)
    face_part = np.zeros(len(faces), dtype=np.int64) if face_part is None else np.array(face_part, dtype=np.int64)
    parts = tuple(Part(f"part {i}", (0.1 + 0.8 / (1 + i), 0.5, 0.5)) for i in range(int(face_part.max()) + 1))
    return Mesh(positions, faces, face_part, parts, own_uv(len(faces)))


def own_uv(faces: int) -> Float[ndarray, "faces 3 2"]:
    """UV triangles that do not touch, one for each face, two in each cell of a square grid."""
    side = int(np.ceil(np.sqrt((faces + 1) // 2)))
    cell = np.arange(faces) // 2
    low = np.array([[0.05, 0.05], [0.85, 0.05], [0.05, 0.85]])
    triangle = np.where((np.arange(faces) % 2 == 0)[:, None, None], low, 1.0 - low)
    return (triangle + np.stack([cell % side, cell // side], axis=1)[:, None, :]) / side


def box(steps: int = 2) -> Mesh:
    """The cube from -1 to 1, closed, with sharp edges; each side is steps x steps squares and a part of its own."""
    grid = np.linspace(-1.0, 1.0, steps + 1)
    s, t = np.meshgrid(grid, grid, indexing="ij")
    corners, faces = [], []
    for side in range(_SIDES):
        axis, sign = side // 2, 1.0 - 2.0 * (side % 2)
        square = np.empty((*s.shape, 3))
        square[..., axis], square[..., axis - 2], square[..., axis - 1] = sign, s * sign, t
        corners.append(square.reshape(-1, 3))
        faces.append(_squares(steps) + side * s.size)
    positions, weld = np.unique(np.concatenate(corners), axis=0, return_inverse=True)
    return mesh_of(positions, weld.reshape(-1)[np.concatenate(faces)], np.repeat(np.arange(_SIDES), 2 * steps * steps))


def _squares(steps: int) -> Int[ndarray, "faces 3"]:
    """The triangles of a grid of squares; where its first axis runs along x and its second along y, they face +z."""
    vertex = np.arange((steps + 1) ** 2).reshape(steps + 1, steps + 1)
    a, b, c, d = (v.ravel() for v in (vertex[:-1, :-1], vertex[1:, :-1], vertex[1:, 1:], vertex[:-1, 1:]))
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])


def sphere(steps: int = 4) -> Mesh:
    """A closed unit sphere about the origin, one part."""
    cube = box(steps)
    return mesh_of(cube.positions / np.linalg.norm(cube.positions, axis=1, keepdims=True), cube.faces)


def body() -> Mesh:
    """A closed, smooth, convex body as large as a car, standing on the ground; its lower half is part 1."""
    round_ = sphere()
    positions = round_.positions * _METRES + (0.0, _METRES[1], 0.0)
    low = positions[round_.faces, 1].mean(axis=1) < _METRES[1]
    return mesh_of(positions, round_.faces, low.astype(np.int64))


def shell() -> Mesh:
    """The upper half of `body`, open below, one part."""
    whole = body()
    return faces_of(whole, whole.face_part == 0)


def nested() -> Mesh:
    """A small `body` (part 0, whose faces come first) inside a large one (part 1), well away from it."""
    return joined(_one_part(moved(body(), 0.4, (0.0, 0.42, 0.0))), _one_part(body()))


def clutter() -> Mesh:
    """Defects of real files: an open shell, a crate with duplicate, degenerate and inverted faces, unused vertices."""
    crate = moved(box(), 0.3, (0.0, 1.8, 0.5))
    faces = np.concatenate([crate.faces, crate.faces[:5], crate.faces[5:8, ::-1], [[0, 1, 1], [2, 2, 2], [0, 0, 0]]])
    part = np.concatenate([crate.face_part, crate.face_part[:8], [0, 1, 2]])
    return with_unused_vertices(joined(shell(), mesh_of(crate.positions, faces, part)), 3.0)


def inset(mesh: Mesh, face: int, scale: float) -> Mesh:
    """The mesh with a small copy of a face in its middle, joined to the face's corners, as its last face."""
    outer = mesh.faces[face]
    corners = mesh.positions[outer]
    inner = len(mesh.positions) + np.arange(3)
    ring = [[outer[k], outer[(k + 1) % 3], inner[(k + 1) % 3]] for k in range(3)]
    ring += [[outer[k], inner[(k + 1) % 3], inner[k]] for k in range(3)]
    faces = np.concatenate([np.delete(mesh.faces, face, axis=0), ring, [inner]])
    part = np.append(np.delete(mesh.face_part, face), np.full(7, mesh.face_part[face]))
    middle = corners.mean(axis=0)
    return mesh_of(np.concatenate([mesh.positions, middle + scale * (corners - middle)]), faces, part)


def faces_of(mesh: Mesh, chosen: Bool[ndarray, " faces"]) -> Mesh:
    """The chosen faces alone, over only the vertices that they use."""
    used, faces = np.unique(mesh.faces[chosen], return_inverse=True)
    return mesh_of(mesh.positions[used], faces.reshape(-1, 3), mesh.face_part[chosen])


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one; their parts stay apart."""
    vertices = np.cumsum([0, *(len(mesh.positions) for mesh in meshes)])
    parts = np.cumsum([0, *(len(mesh.parts) for mesh in meshes)])
    return mesh_of(
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate([mesh.faces + first for mesh, first in zip(meshes, vertices, strict=False)]),
        np.concatenate([mesh.face_part + first for mesh, first in zip(meshes, parts, strict=False)]),
    )


def moved(mesh: Mesh, scale: float, offset: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """The mesh scaled about the origin, then moved."""
    return replace(mesh, positions=mesh.positions * scale + offset)


def with_unused_vertices(mesh: Mesh, distance: float) -> Mesh:
    """The mesh with an unused vertex before and one after its own, at -`distance` and `distance` on every axis."""
    corner = np.full((1, 3), distance)
    return replace(mesh, positions=np.concatenate([-corner, mesh.positions, corner]), faces=mesh.faces + 1)


def _one_part(mesh: Mesh) -> Mesh:
    return mesh_of(mesh.positions, mesh.faces)
