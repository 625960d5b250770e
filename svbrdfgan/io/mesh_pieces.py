"""Read OBJ, PLY and STL files as a list of pieces, by trimesh, without merging, dropping or smoothing anything."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.materials import Pictures, read_look
from svbrdfgan.io.mesh_bytes import open_mesh
from svbrdfgan.io.neighbours import Neighbours
from svbrdfgan.io.pieces import Piece
from svbrdfgan.types import Part


def trimesh_pieces(path: Path) -> list[Piece]:
    """The triangles of an OBJ, PLY or STL file, in an order that depends only on the file. Parsers raise many types."""
    return _pieces(path, _load(path, path.suffix.lower().removeprefix("."), open_mesh(path)))


def _load(path: Path, kind: str, content: BytesIO) -> Any:
    """The file as a `trimesh.Scene`, unprocessed."""
    import trimesh

    resolver: Any = Neighbours(path)
    with _silent(trimesh.util.log):  # trimesh logs a missing picture's traceback, and `Neighbours` a sentence
        return trimesh.load(content, file_type=kind, force="scene", resolver=resolver, process=False)


@contextmanager
def _silent(log: logging.Logger) -> Iterator[None]:
    disabled, log.disabled = log.disabled, True
    try:
        yield
    finally:
        log.disabled = disabled


def _pieces(path: Path, scene: Any) -> list[Piece]:
    import trimesh

    order = {name: index for index, name in enumerate(scene.geometry)}
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed.sort(key=lambda place: (order[place[1]], place[0].tolist()))
    solid = [(matrix, name) for matrix, name in placed if isinstance(scene.geometry[name], trimesh.Trimesh)]
    if placed and not solid:
        raise AssetError(f"{path} holds only points or lines, no faces; export it as a mesh.")
    pictures = Pictures(path)
    looks = {
        name: read_look(pictures, name if len(order) > 1 else path.stem, scene.geometry[name].visual)
        for name in dict.fromkeys(name for _, name in solid)
    }
    return [_piece(path, scene.geometry[name], np.asarray(matrix), looks[name]) for matrix, name in solid]


def _piece(path: Path, geometry: Any, matrix: Float[ndarray, "4 4"], look: Part) -> Piece:
    """Geometry with its node's transform applied. Mirroring transforms reverse the winding, as glTF specifies."""
    vertices = np.asarray(geometry.vertices, dtype=np.float64)
    faces = np.asarray(geometry.faces, dtype=np.int64)
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise AssetError(f"{path} has faces that name vertices outside 0..{len(vertices) - 1}; is it whole?")
    if np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) < 0:
        faces = faces[:, ::-1]
    return Piece(vertices @ matrix[:3, :3].T + matrix[:3, 3], faces, (_own_uv(geometry),), look)


def _own_uv(geometry: Any) -> Float[ndarray, "vertices 2"] | None:
    import trimesh

    uv = geometry.visual.uv if isinstance(geometry.visual, trimesh.visual.TextureVisuals) else None
    if uv is None or len(uv) != len(geometry.vertices) or np.ndim(uv) != 2 or uv.shape[1] < 2:
        return None  # an OBJ file may have lines of one coordinate
    return np.asarray(uv, dtype=np.float64)[:, :2]
