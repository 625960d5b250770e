"""Read mesh files as a list of pieces, through trimesh, without merging, dropping or smoothing anything."""

from __future__ import annotations

import logging
import mimetypes
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_header import HeaderMaterial, read_materials
from svbrdfgan.io.materials import Pictures, read_part
from svbrdfgan.io.mesh_bytes import as_utf8, open_mesh
from svbrdfgan.types import Part

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one material in world coordinates. Parts of different pieces may have the same name."""

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    uv: Float[ndarray, "vertices 2"] | None
    part: Part


@dataclass(frozen=True)
class Neighbours:
    """A trimesh resolver: reads the files that a mesh file refers to (materials, images, buffers)."""

    path: Path

    @property
    def file_name(self) -> str:
        return self.path.stem

    def get(self, name: str) -> bytes:
        """The bytes of a file, by its path relative to the mesh's folder, or by its file name in that folder.

        A missing file causes a warning. A missing image is returned as empty bytes, because the mesh loads without it.

        Raises:
            FileNotFoundError: a file that is not an image is missing.
        """
        plain = name.strip().replace("\\", "/")
        for candidate in (plain, unquote(plain), Path(unquote(plain)).name):
            if candidate and (self.path.parent / candidate).is_file():
                data = (self.path.parent / candidate).read_bytes()
                return as_utf8(data) if candidate.lower().endswith(".mtl") else data
        log.warning("%s names the file '%s', which is missing", self.path, name.strip())
        if (mimetypes.guess_type(plain)[0] or "").startswith("image/"):
            return b""
        raise FileNotFoundError(f"the file '{name.strip()}' that it names is missing")

    __getitem__ = get


def read_pieces(path: Path) -> list[Piece]:
    """The triangles of a mesh file: one piece per instance of each mesh, in an order that depends only on the file.

    Raises:
        AssetError: the file is broken, truncated, not of the kind that its suffix says, or has no triangles.
    """
    kind = path.suffix.lower().removeprefix(".")
    try:
        header = read_materials(path) if kind in ("glb", "gltf") else ()
        return _pieces(path, _load(path, kind), header)
    except AssetError:
        raise
    except FileNotFoundError as error:
        raise AssetError(f"{path} cannot be read: {error}.") from error
    except Exception as error:  # parsers raise many types; each means that the file is invalid
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise AssetError(f"{path} cannot be read as {kind.upper()} ({reason}); is it whole?") from error


def _load(path: Path, kind: str) -> Any:
    """The file as a `trimesh.Scene`, unprocessed."""
    import trimesh

    resolver: Any = Neighbours(path)
    return trimesh.load(open_mesh(path), file_type=kind, force="scene", resolver=resolver, process=False)


def _pieces(path: Path, scene: Any, header: tuple[HeaderMaterial, ...]) -> list[Piece]:
    import trimesh

    order = {name: index for index, name in enumerate(scene.geometry)}
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed.sort(key=lambda place: (order[place[1]], place[0].tolist()))
    solid = [(matrix, name) for matrix, name in placed if isinstance(scene.geometry[name], trimesh.Trimesh)]
    if placed and not solid:
        raise AssetError(f"{path} holds only points or lines, no faces; export it as a mesh.")
    pictures = Pictures(path)
    parts = {
        name: read_part(pictures, name if len(order) > 1 else path.stem, scene.geometry[name].visual, header)
        for name in dict.fromkeys(name for _, name in solid)
    }
    return [_piece(path, scene.geometry[name], np.asarray(matrix), parts[name]) for matrix, name in solid]


def _piece(path: Path, geometry: Any, matrix: Float[ndarray, "4 4"], part: Part) -> Piece:
    """Geometry with its node's transform applied. Mirroring transforms reverse the winding, as glTF specifies."""
    import trimesh

    vertices = np.asarray(geometry.vertices, dtype=np.float64)
    faces = np.asarray(geometry.faces, dtype=np.int64)
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise AssetError(f"{path} has faces that name vertices outside 0..{len(vertices) - 1}; is it whole?")
    if np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) < 0:
        faces = faces[:, ::-1]
    uv = geometry.visual.uv if isinstance(geometry.visual, trimesh.visual.TextureVisuals) else None
    fits = uv is not None and len(uv) == len(vertices)
    uv = np.asarray(uv, dtype=np.float64)[:, :2] if fits else None
    return Piece(vertices @ matrix[:3, :3].T + matrix[:3, 3], faces, uv, part)
