"""Read mesh files as a list of pieces, through trimesh, without merging, dropping or smoothing anything."""

from __future__ import annotations

import logging
import mimetypes
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_header import HeaderMaterial, read_materials
from svbrdfgan.io.image import linear_from_picture, linear_from_srgb
from svbrdfgan.io.mesh_bytes import as_utf8, open_mesh
from svbrdfgan.types import Part

if TYPE_CHECKING:
    from PIL.Image import Image

log = logging.getLogger(__name__)

Color = tuple[float, float, float]
WHITE: Color = (1.0, 1.0, 1.0)


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
    pictures: dict[int, ndarray | None] = {}
    parts = {
        name: _part(path, name if len(order) > 1 else path.stem, scene.geometry[name].visual, header, pictures)
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


def _part(
    path: Path, name: str, visual: Any, header: tuple[HeaderMaterial, ...], pictures: dict[int, ndarray | None]
) -> Part:
    """The part for a trimesh visual, named after its material, or after its mesh if the material has no name."""
    import trimesh

    if not isinstance(visual, trimesh.visual.TextureVisuals):
        return _colored_part(path, name, visual)
    material = visual.material
    if isinstance(material, trimesh.visual.material.PBRMaterial):
        color, textured = _gltf_color(material, header)
        image = material.baseColorTexture
    elif not material.kwargs and material.image is not None and material.image.format is None:
        return Part(name)  # trimesh's placeholder material, for a file with UVs but no material
    else:
        color, textured = _mtl_color(material), False
        image = material.image
    if id(image) not in pictures:
        pictures[id(image)] = _texture(path, image)
    texture = pictures[id(image)]
    if textured and image is None:
        log.warning("%s: the picture of material '%s' cannot be read; its colour is used alone", path, material.name)
    red, green, blue = np.clip(np.nan_to_num(color), 0.0, 1.0).tolist()
    return Part(material.name or name, (red, green, blue), texture)


def _colored_part(path: Path, name: str, visual: Any) -> Part:
    """A part with the mean of the vertex or face colours (sRGB in the file), or the default colour if it has none."""
    if visual.kind not in ("vertex", "face"):
        return Part(name)
    log.info("%s: colours of single vertices or faces are averaged over '%s'", path, name)
    colors = np.asarray(visual.vertex_colors if visual.kind == "vertex" else visual.face_colors)[:, :3] / 255.0
    red, green, blue = linear_from_srgb(torch.from_numpy(colors)).mean(dim=0).tolist()
    return Part(name, (red, green, blue))


def _gltf_color(material: Any, header: tuple[HeaderMaterial, ...]) -> tuple[Color, bool]:
    """Base colour in full precision, and whether there is a texture: from the header's nearest material of that name.

    trimesh rounds the colour to 8 bits.
    """
    stored = WHITE if material.baseColorFactor is None else tuple(material.baseColorFactor[:3] / 255.0)
    named = [entry for entry in header if entry.name == material.name]
    near = min(named, key=lambda entry: np.abs(np.subtract(entry.base_color, stored)).max(), default=None)
    if near is None:
        return stored, False
    return near.base_color, near.textured


def _mtl_color(material: Any) -> Color:
    """Kd, read as linear. With a texture, a missing or black Kd is replaced by white, because exporters write it so."""
    diffuse = material.kwargs.get("kd")
    usable = isinstance(diffuse, list) and len(diffuse) == 3
    if material.image is not None and not (usable and any(diffuse)):
        return WHITE
    return tuple(diffuse) if usable else Part("").base_color


def _texture(path: Path, image: Image | None) -> Float[ndarray, "rows cols 3"] | None:
    """Linear RGB with row 0 at v = 0. None if there is no image, or, with a warning, if it is broken."""
    if image is None:
        return None
    try:
        return linear_from_picture(image)[..., :3].flip(0).numpy()
    except (OSError, SyntaxError, ValueError) as error:
        log.warning("%s has a picture that cannot be read (%s); colours are used alone", path, error)
        return None
