"""Write GLB files: surfaces with their generated textures, and unchanged meshes.

This module writes GLB itself instead of using a mesh library: colour factors keep their precision, parts share images,
and textures clamp or repeat as the surface requires.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.image import linear_from_srgb, texture_png
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.types import Mesh, Part, Surface

Texture = Float[Tensor, "rows cols channels"]

# Constants of the glTF 2.0 specification (OpenGL enumerants).
FLOAT, UINT = 5126, 5125
VERTICES, INDICES = 34962, 34963
LINEAR, CLAMP, REPEAT = 9729, 33071, 10497
ROUGHNESS = 0.9


@dataclass
class _Document:
    """A GLB file under construction: its JSON tables and its binary chunk."""

    repeat: tuple[bool, bool]
    binary: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    materials: list[dict[str, Any]] = field(default_factory=list)
    meshes: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)
    image_of: dict[int, int] = field(default_factory=dict)


def save_glb(
    path: str | os.PathLike[str],
    surface: Surface,
    textures: Mapping[int, Texture],
    gloss: Mapping[int, Float[Tensor, "rows cols 2"]] = MappingProxyType({}),
) -> None:
    """Writes a surface as GLB, with one mesh per part.

    A texture that is given for several parts is stored once. A part without a texture gets its base colour, multiplied
    by the mean of its own texture (which does not fit the surface's UVs).

    Args:
        textures: linear base colour in [0, 1] by index of the part, row 0 at v = 0. RGB is opaque; RGBA is blended by
            its straight alpha.
        gloss: roughness and metallic in [0, 1] by index of the part; other parts are rough and not metallic.

    Raises:
        AssetError: the suffix is not .glb, a texture's part or shape is wrong, or the file cannot be written.
    """
    _check_suffix(path)
    for given, channels in ((textures, (3, 4)), (gloss, (2,))):
        for index, picture in given.items():
            _check_texture(path, surface, index, picture, channels)
    document = _Document(surface.repeat)
    for index, part in enumerate(surface.parts):
        used, faces = np.unique(surface.faces[surface.face_part == index], return_inverse=True)
        if len(used):
            texture = textures.get(index)
            color = _mean_color(part) if texture is None else (1.0, 1.0, 1.0)
            material = _add_material(document, part.name, color, texture, gloss.get(index))
            attributes = {"POSITION": surface.positions, "NORMAL": surface.normals, "TEXCOORD_0": _top_left(surface.uv)}
            _add_mesh(document, part.name, {name: a[used] for name, a in attributes.items()}, faces, material)
    _write(path, document)


def save_mesh_glb(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Writes a mesh as GLB. `load_mesh` returns the same triangles, parts and UVs (positions rounded to float32).

    No normals are written: viewers shade the mesh flat, and this package computes its own normals.

    Raises:
        AssetError: the suffix is not .glb, or the file cannot be written.
    """
    _check_suffix(path)
    document = _Document((True, True))
    textures = {id(part.texture): torch.from_numpy(part.texture) for part in mesh.parts if part.texture is not None}
    for index, part in enumerate(mesh.parts):
        chosen = mesh.face_part == index
        if chosen.any():
            attributes, faces = _split_corners(mesh, chosen)
            texture = textures.get(id(part.texture)) if mesh.uv is not None else None
            material = _add_material(document, part.name, part.base_color, texture)
            _add_mesh(document, part.name, attributes, faces, material)
    _write(path, document)


def _check_texture(
    path: str | os.PathLike[str], surface: Surface, index: int, texture: Texture, channels: tuple[int, ...]
) -> None:
    if not 0 <= index < len(surface.parts):
        raise AssetError(
            f"{path}: a texture is given for part {index}, but the surface has {len(surface.parts)} parts."
        )
    if texture.ndim != 3 or texture.shape[2] not in channels or texture.numel() == 0:
        wanted = " | ".join(map(str, channels))
        raise AssetError(f"{path}: texture {index} has shape {tuple(texture.shape)}; wanted (rows, cols, {wanted}).")


def _check_suffix(path: str | os.PathLike[str]) -> None:
    if Path(path).suffix.lower() != ".glb":
        raise AssetError(f"{path} does not end in .glb, the one kind of mesh file that is written.")


def _mean_color(part: Part) -> tuple[float, float, float]:
    """The part's linear base colour times the mean of its texture, if it has one."""
    tint = np.ones(3) if part.texture is None else part.texture.reshape(-1, 3).mean(axis=0, dtype=np.float64)
    red, green, blue = (tint * part.base_color).tolist()
    return red, green, blue


def _top_left(uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, "vertices 2"]:
    """glTF's texture coordinates, whose origin is the image's upper left corner."""
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1)


def _split_corners(mesh: Mesh, chosen: ndarray) -> tuple[dict[str, ndarray], Int[ndarray, " corners"]]:
    """Attributes of one vertex for each distinct position and UV of the chosen faces, and the corners' indices."""
    vertex = mesh.faces[chosen].reshape(-1)
    if mesh.uv is None:
        used, faces = np.unique(vertex, return_inverse=True)
        return {"POSITION": mesh.positions[used]}, faces
    uv = mesh.uv[chosen].reshape(-1, 2)
    split, faces = merge_rows(np.column_stack([vertex, uv]))
    attributes = {"POSITION": mesh.positions[split[:, 0].astype(np.int64)], "TEXCOORD_0": _top_left(split[:, 1:])}
    return attributes, faces


def _add_view(document: _Document, data: bytes, target: int | None = None) -> int:
    view: dict[str, Any] = {"buffer": 0, "byteOffset": len(document.binary), "byteLength": len(data)}
    document.views.append(view if target is None else {**view, "target": target})
    # glTF requires 4-byte alignment of accessors and chunks
    document.binary += data + b"\0" * (-len(data) % 4)
    return len(document.views) - 1


def _add_accessor(document: _Document, array: ndarray, kind: str, component: int, target: int) -> int:
    accessor: dict[str, Any] = {
        "bufferView": _add_view(document, array.tobytes(), target),
        "componentType": component,
        "count": len(array),
        "type": kind,
    }
    if kind == "VEC3":  # glTF requires min and max for POSITION
        accessor |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
    document.accessors.append(accessor)
    return len(document.accessors) - 1


def _add_mesh(
    document: _Document, name: str, attributes: Mapping[str, ndarray], faces: Int[ndarray, "*corners"], material: int
) -> None:
    indices = faces.reshape(-1).astype("<u4")
    primitive = {
        "attributes": {
            key: _add_accessor(document, array.astype("<f4"), f"VEC{array.shape[1]}", FLOAT, VERTICES)
            for key, array in attributes.items()
        },
        "indices": _add_accessor(document, indices, "SCALAR", UINT, INDICES),
        "material": material,
    }
    document.meshes.append({"name": name, "primitives": [primitive]})


def _add_material(
    document: _Document,
    name: str,
    color: tuple[float, float, float],
    texture: Texture | None,
    gloss: Texture | None = None,
) -> int:
    pbr: dict[str, Any] = {"baseColorFactor": [*color, 1.0], "metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
    blend = texture is not None and texture.shape[2] == 4
    if texture is not None:
        pbr["baseColorTexture"] = {"index": _add_image(document, texture, texture)}
    if gloss is not None:
        # glTF: green is roughness, blue is metallic, both linear. This undoes the sRGB encoding by `texture_png`.
        numbers = linear_from_srgb(torch.cat([torch.zeros_like(gloss[..., :1]), gloss.clamp(0, 1)], dim=-1))
        pbr |= {"metallicFactor": 1.0, "roughnessFactor": 1.0}
        pbr["metallicRoughnessTexture"] = {"index": _add_image(document, gloss, numbers)}
    document.materials.append(
        {
            "name": name,
            "pbrMetallicRoughness": pbr,
            "alphaMode": "BLEND" if blend else "OPAQUE",
            "doubleSided": True,
        }
    )
    return len(document.materials) - 1


def _add_image(document: _Document, given: Texture, shown: Texture) -> int:
    """The index of the image `shown`; it is stored once for all parts with the same texture `given`."""
    if id(given) not in document.image_of:
        document.image_of[id(given)] = len(document.images)
        view = _add_view(document, texture_png(shown))
        document.images.append({"bufferView": view, "mimeType": "image/png"})
    return document.image_of[id(given)]


def _header(document: _Document) -> dict[str, Any]:
    wrap_u, wrap_v = (REPEAT if repeats else CLAMP for repeats in document.repeat)
    header: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "svbrdfgan"},
        "scene": 0,
        "scenes": [{"nodes": list(range(len(document.meshes)))}],
        "nodes": [{"name": mesh["name"], "mesh": index} for index, mesh in enumerate(document.meshes)],
        "meshes": document.meshes,
        "materials": document.materials,
        "accessors": document.accessors,
        "bufferViews": document.views,
        "buffers": [{"byteLength": len(document.binary)}],
    }
    if document.images:
        header["images"] = document.images
        header["samplers"] = [{"magFilter": LINEAR, "minFilter": LINEAR, "wrapS": wrap_u, "wrapT": wrap_v}]
        header["textures"] = [{"sampler": 0, "source": index} for index in range(len(document.images))]
    return header


def _write(path: str | os.PathLike[str], document: _Document) -> None:
    text = json.dumps(_header(document), separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    size = 12 + 8 + len(text) + 8 + len(document.binary)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, size))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        file.write(struct.pack("<I4s", len(document.binary), b"BIN\0") + document.binary)
