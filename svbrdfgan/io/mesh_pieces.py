"""Read mesh files as a list of pieces, through trimesh, without merging, dropping or smoothing anything."""

from __future__ import annotations

import logging
import mimetypes
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_header import UV_ATTRIBUTE, HeaderMaterial, read_header, read_materials, readable
from svbrdfgan.io.materials import Look, Pictures, read_look
from svbrdfgan.io.mesh_bytes import as_utf8, open_mesh
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import Part

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Piece:
    """Triangles of one material in world coordinates. Parts of different pieces may have the same name.

    Attributes:
        uv_sets: the file's own UVs, or None, and the further sets that the part's textures are looked up in.
    """

    positions: Float[ndarray, "vertices 3"]
    faces: Int[ndarray, "faces 3"]
    uv_sets: tuple[Float[ndarray, "vertices 2"] | None, ...]
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

        Files outside of that folder are not read, whatever the mesh names: it may come from a stranger, and what it
        names may be a device that never ends. A missing file causes a warning. A missing image is returned as empty
        bytes, because the mesh loads without it.

        Raises:
            FileNotFoundError: a file that is not an image is missing.
        """
        plain, folder = name.strip().replace("\\", "/"), self.path.parent.resolve()
        for candidate in (plain, unquote(plain), Path(unquote(plain)).name):
            found = (folder / candidate).resolve()
            if found.is_file() and found.is_relative_to(folder):
                data = found.read_bytes()
                return as_utf8(data) if candidate.lower().endswith(".mtl") else data
        log.warning("%s names the file '%s', which is missing or outside of its folder", self.path, name.strip())
        if (mimetypes.guess_type(plain)[0] or "").startswith("image/"):
            return b""
        raise FileNotFoundError(f"the file '{name.strip()}' that it names is missing or outside of its folder")

    __getitem__ = get


def read_pieces(path: Path) -> list[Piece]:
    """The triangles of a mesh file: one piece per instance of each mesh, in an order that depends only on the file.

    Raises:
        AssetError: the file is broken, truncated, not of the kind that its suffix says, or has no triangles.
    """
    kind = path.suffix.lower().removeprefix(".")
    try:
        if kind not in ("glb", "gltf"):
            return _pieces(path, _load(path, kind, open_mesh(path)), ())
        header = read_header(path)
        return _pieces(path, _load(path, kind, readable(path, header)), read_materials(header))
    except AssetError:
        raise
    except FileNotFoundError as error:
        raise AssetError(f"{path} cannot be read: {error}.") from error
    except Exception as error:  # parsers raise many types; each means that the file is invalid
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise AssetError(f"{path} cannot be read as {kind.upper()} ({reason}); is it whole?") from error


def _load(path: Path, kind: str, content: BytesIO) -> Any:
    """The file as a `trimesh.Scene`, unprocessed."""
    import trimesh

    resolver: Any = Neighbours(path)
    return trimesh.load(content, file_type=kind, force="scene", resolver=resolver, process=False)


def _pieces(path: Path, scene: Any, header: tuple[HeaderMaterial, ...]) -> list[Piece]:
    import trimesh

    order = {name: index for index, name in enumerate(scene.geometry)}
    placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed.sort(key=lambda place: (order[place[1]], place[0].tolist()))
    solid = [(matrix, name) for matrix, name in placed if isinstance(scene.geometry[name], trimesh.Trimesh)]
    if placed and not solid:
        raise AssetError(f"{path} holds only points or lines, no faces; export it as a mesh.")
    pictures = Pictures(path)
    looks = {
        name: read_look(pictures, name if len(order) > 1 else path.stem, scene.geometry[name].visual, header)
        for name in dict.fromkeys(name for _, name in solid)
    }
    return [_piece(path, scene.geometry[name], np.asarray(matrix), looks[name]) for matrix, name in solid]


def _piece(path: Path, geometry: Any, matrix: Float[ndarray, "4 4"], look: Look) -> Piece:
    """Geometry with its node's transform applied. Mirroring transforms reverse the winding, as glTF specifies."""
    vertices = np.asarray(geometry.vertices, dtype=np.float64)
    faces = np.asarray(geometry.faces, dtype=np.int64)
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise AssetError(f"{path} has faces that name vertices outside 0..{len(vertices) - 1}; is it whole?")
    if np.isfinite(matrix).all() and np.linalg.det(matrix[:3, :3]) < 0:
        faces = faces[:, ::-1]
    uv_sets = (_own_uv(geometry), *(_further_uv(path, geometry, uv_set) for uv_set in look.further))
    return Piece(vertices @ matrix[:3, :3].T + matrix[:3, 3], faces, uv_sets, look.part)


def _own_uv(geometry: Any) -> Float[ndarray, "vertices 2"] | None:
    import trimesh

    uv = geometry.visual.uv if isinstance(geometry.visual, trimesh.visual.TextureVisuals) else None
    if uv is None or len(uv) != len(geometry.vertices) or np.ndim(uv) != 2 or uv.shape[1] < 2:
        return None  # an OBJ file may have lines of one coordinate
    return np.asarray(uv, dtype=np.float64)[:, :2]


def _further_uv(path: Path, geometry: Any, uv_set: UVSet) -> Float[ndarray, "vertices 2"]:
    """The coordinates that a texture is looked up at; zeros, with a warning, if the file does not have the set."""
    uv = _own_uv(geometry)
    if uv_set.number > 0:
        stored = geometry.vertex_attributes.get(UV_ATTRIBUTE.format(uv_set.number))
        uv = None if stored is None else np.asarray(stored, dtype=np.float64) * (1.0, -1.0) + (0.0, 1.0)
    if uv is None:
        log.warning("%s has a texture over TEXCOORD_%d, which its mesh lacks", path, uv_set.number)
        uv = np.zeros((len(geometry.vertices), 2))
    return uv_set.moved(uv)
