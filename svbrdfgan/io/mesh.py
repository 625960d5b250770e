"""Load mesh files (GLB, glTF, OBJ, PLY, STL) as one `Mesh`: one part per material, transforms applied, welded."""

from __future__ import annotations

import logging
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.files import check_file, parsing
from svbrdfgan.io.gltf.document import SUFFIXES as DOCUMENTS
from svbrdfgan.io.gltf.document import read_document
from svbrdfgan.io.gltf.pieces import document_pieces
from svbrdfgan.io.mesh_pieces import trimesh_pieces
from svbrdfgan.io.pieces import MAX_FACES, Piece
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.types import Mesh, Part

log = logging.getLogger(__name__)

SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl")
MAX_COORDINATE = 1e9


def load_mesh(path: str | os.PathLike[str]) -> Mesh:
    """The triangles of a mesh file, with its materials as parts and its own UVs where it has any.

    Of glTF it reads base colour, roughness, metallic, normal textures and alpha; of MTL colour, alpha, `Pr` and `Pm`.
    Textures may have UVs of their own, in glTF by `texCoord` and KHR_texture_transform. Other extensions are ignored,
    and so are normals and tangents: the package computes its own.

    Vertices at equal positions are merged, also across materials, and faces that lose a corner by this are dropped. If
    only some meshes of a file have UVs, the others get zeros. A missing or broken texture image causes a warning.

    Raises:
        AssetError: the file is missing, broken or of another kind, has no faces, or has invalid coordinates.
    """
    path = check_file(path, SUFFIXES, "mesh")
    return join_pieces(path, _read_pieces(path)).mesh


def _read_pieces(path: Path) -> list[Piece]:
    kind = path.suffix.lower()
    with parsing(path, kind[1:].upper()):
        return document_pieces(read_document(path)) if kind in DOCUMENTS else trimesh_pieces(path)


@dataclass(frozen=True, eq=False)
class Joined:
    """A mesh of pieces, and where each of its faces comes from: a piece, by index, and a face of that piece."""

    mesh: Mesh
    piece: Int[ndarray, " faces"]
    piece_face: Int[ndarray, " faces"]


def join_pieces(path: Path, pieces: Sequence[Piece]) -> Joined:
    """All pieces as one checked, welded mesh, without degenerate faces (repeated vertices) and unused vertices.

    Raises:
        AssetError: there are no faces, too many, or invalid coordinates.
    """
    counts = [len(piece.faces) for piece in pieces]
    if not 0 < sum(counts) <= MAX_FACES:
        raise AssetError(f"{path} holds {sum(counts) or 'no'} faces; wanted a mesh of 1 to {MAX_FACES} triangles.")
    owner = np.repeat(np.arange(len(pieces)), counts)
    own_face = np.concatenate([np.arange(count) for count in counts])
    mesh, keep = _joined(path, [piece for piece in pieces if len(piece.faces)])
    return Joined(mesh, owner[keep], own_face[keep])


def _joined(path: Path, pieces: Sequence[Piece]) -> tuple[Mesh, Bool[ndarray, " faces"]]:
    """The mesh of pieces that all have faces, and which of these it keeps."""
    positions = np.concatenate([piece.positions for piece in pieces])
    _check_positions(path, positions)
    starts = np.cumsum([0] + [len(piece.positions) for piece in pieces[:-1]])
    corners = np.concatenate([piece.faces + start for piece, start in zip(pieces, starts, strict=True)])
    parts, piece_part = _merge_parts([piece.part for piece in pieces])
    face_part = np.repeat(piece_part, [len(piece.faces) for piece in pieces])
    sets = [_corner_uv(path, pieces, corners, k) for k in range(max(len(piece.uv_sets) for piece in pieces))]
    positions, welded = merge_rows(positions)
    faces = welded[corners]
    keep = _proper(faces)
    if not keep.all():
        log.info("%s: dropped %d of %d faces that name a vertex twice", path, int((~keep).sum()), len(keep))
    if not keep.any():
        raise AssetError(f"{path} holds only faces without area; export it again.")
    positions, faces = _used(positions, faces[keep])
    _check_extent(path, positions)
    uv, *further = [None if uv is None else uv[keep] for uv in sets]
    mesh = Mesh(positions, faces, face_part[keep], parts, uv, tuple(each for each in further if each is not None))
    return mesh, keep


def _merge_parts(found: Sequence[Part]) -> tuple[tuple[Part, ...], Int[ndarray, " pieces"]]:
    """Parts with unique names, and the part of each piece. Equal parts are merged; other namesakes get a number."""
    index: dict[tuple[object, ...], int] = {}
    parts: list[Part] = []
    numbers: dict[str, int] = {}
    for part in found:
        if _identity(part) not in index:
            index[_identity(part)] = len(parts)
            parts.append(replace(part, name=_free_name(part.name, numbers)))
    return tuple(parts), np.array([index[_identity(part)] for part in found])


def _identity(part: Part) -> tuple[object, ...]:
    """Equal for parts of equal name and material. Textures are compared by their arrays, which a file's parts share."""
    maps = [(name, m.factor, m.cutoff, id(m.texture), m.uv_set) for name, m in sorted(part.all_maps.items())]
    return part.name, *maps


def _free_name(name: str, numbers: dict[str, int]) -> str:
    """`name`, with a number appended if it is taken; `numbers` holds what is taken, and the last number of each."""
    free = name
    while free in numbers:
        numbers[name] += 1
        free = f"{name}_{numbers[name]}"
    numbers[free] = 1
    return free


def _corner_uv(
    path: Path, pieces: Sequence[Piece], corners: Int[ndarray, "faces 3"], number: int
) -> Float[ndarray, "faces 3 2"] | None:
    """The UV of each corner in one set, zeros for pieces without it; None if no piece has it."""
    found = [piece.uv_sets[number] if number < len(piece.uv_sets) else None for piece in pieces]
    if all(uv is None for uv in found):
        return None
    vertices = [len(piece.positions) for piece in pieces]
    uv = np.concatenate([np.zeros((n, 2)) if uv is None else uv for uv, n in zip(found, vertices, strict=True)])
    if not np.isfinite(uv).all():
        log.warning("%s has texture coordinates that are not finite; they became 0", path)
        uv = np.where(np.isfinite(uv), uv, 0.0)
    return uv[corners]


def _proper(faces: Int[ndarray, "faces 3"]) -> Bool[ndarray, " faces"]:
    """A mask of the faces whose three vertices differ."""
    a, b, c = faces.T
    return (a != b) & (b != c) & (c != a)


def _used(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]
) -> tuple[Float[ndarray, "used 3"], Int[ndarray, "faces 3"]]:
    """The positions that faces use, and the faces with indices into them."""
    used = np.zeros(len(positions), dtype=bool)
    used[faces] = True
    return positions[used], (np.cumsum(used) - 1)[faces]


def _check_positions(path: Path, positions: Float[ndarray, "vertices 3"]) -> None:
    broken = ~np.isfinite(positions).all(axis=1)
    if broken.any():
        raise AssetError(
            f"{path} has {int(broken.sum())} vertices that are not finite (NaN or infinite); export it again."
        )
    largest = np.abs(positions).max()
    if largest > MAX_COORDINATE:
        raise AssetError(f"{path} has a coordinate of {largest:g}; wanted metres, at most {MAX_COORDINATE:g}.")


def _check_extent(path: Path, positions: Float[ndarray, "vertices 3"]) -> None:
    size = np.ptp(positions, axis=0)
    if np.sort(size)[1] < 1e-9:
        raise AssetError(
            f"{path} is {size[0]:g} x {size[1]:g} x {size[2]:g} metres, which has no area; check its scale."
        )
