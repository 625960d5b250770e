"""Write GLB files: surfaces with their generated textures, and unchanged meshes.

The module writes GLB itself instead of using a mesh library: colour factors keep their precision, parts share images,
and textures clamp or repeat as the surface requires.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
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
from svbrdfgan.io.gltf_header import LAMBERTIAN
from svbrdfgan.io.image import texture_png
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.types import FileMap, Mesh, Part, Surface
from svbrdfgan.types.geometry import FILE_CHANNELS

Texture = Float[Tensor, "rows cols channels"]

# Constants of the glTF 2.0 specification (OpenGL enumerants).
FLOAT = 5126  # component types of accessors
UINT = 5125
VERTICES = 34962  # targets of buffer views
INDICES = 34963
LINEAR = 9729  # filter of samplers
CLAMP = 33071  # wrapping of samplers
REPEAT = 10497

ROUGHNESS = 0.9
"""The roughness with which viewers show parts without gloss, which glTF does not know."""


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
    image_of: dict[tuple[Any, ...], int] = field(default_factory=dict)
    kept: list[Any] = field(default_factory=list)
    """The textures whose addresses are keys of `image_of`, so that no other takes their place in memory."""


def save_glb(
    path: str | os.PathLike[str],
    surface: Surface,
    textures: Mapping[int, Texture],
    maps: Mapping[int, Mapping[str, Float[Tensor, "*shape"]]] = MappingProxyType({}),
    tangents: Float[ndarray, "faces 3 4"] | None = None,
) -> None:
    """Writes a surface as GLB, with one mesh per part.

    A texture that is given for several parts is stored once. A part without a texture gets its base colour, multiplied
    by the mean of its own texture (which does not fit the surface's UVs). Parts keep their `alpha`.

    Args:
        textures: linear base colour in [0, 1] by index of the part, row 0 at v = 0. RGB has the part's own alpha; RGBA
            is blended by its straight alpha.
        maps: `roughness`, `metallic` and `normal` by index of the part and by name, each (channels,) or
            (rows, cols, channels). Parts without roughness are marked as Lambertian, which viewers do not know: they
            show them rough and not metallic.
        tangents: at each corner, the unit tangent and the handedness. Written for parts with a normal texture.

    Raises:
        AssetError: the suffix is not .glb, a texture's part or shape is wrong, or the file cannot be written.
    """
    _check_suffix(path)
    for index, picture in textures.items():
        _check_texture(path, surface, index, picture, (3, 4))
    for index, named in maps.items():
        for name, values in named.items():
            _check_texture(
                path, surface, index, values.expand(1, 1, -1) if values.ndim == 1 else values, (FILE_CHANNELS[name],)
            )
    document = _Document(surface.repeat)
    for index, part in enumerate(surface.parts):
        chosen = surface.face_part == index
        if chosen.any():
            look = _surface_maps(part, textures.get(index), maps.get(index, {}))
            material = _add_material(document, part.name, look)
            framed = tangents if "normal" in look else None
            _add_mesh(document, part.name, *_surface_attributes(surface, chosen, framed), material)
    _write(path, document)


def save_mesh_glb(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Writes a mesh as GLB. `load_mesh` returns the same triangles, parts and UVs (positions rounded to float32).

    No normals are written: viewers shade the mesh flat, and this package computes its own normals.

    Raises:
        AssetError: the suffix is not .glb, or the file cannot be written.
    """
    _check_suffix(path)
    document = _Document((True, True))
    for index, part in enumerate(mesh.parts):
        chosen = mesh.face_part == index
        if chosen.any():
            look = {name: _over(mesh, given) for name, given in part.all_maps.items()}
            if "normal" in look and look["normal"].texture is None:
                del look["normal"]
            material = _add_material(document, part.name, look)
            sets = range(1 + max((given.uv_set for given in look.values() if given.texture is not None), default=0))
            _add_mesh(document, part.name, *_split_corners(mesh, chosen, sets), material)
    _write(path, document)


def _over(mesh: Mesh, given: FileMap) -> FileMap:
    """The map, without its texture where the mesh has no UVs for it."""
    return given if mesh.uv_set(given.uv_set) is not None else replace(given, texture=None)


def _surface_maps(
    part: Part, texture: Texture | None, further: Mapping[str, Float[Tensor, "*shape"]]
) -> dict[str, FileMap]:
    """The maps of a surface's part, as `_add_material` takes them."""
    color = FileMap(_mean_color(part)) if texture is None else _file_map(texture[..., :3])
    look = {"base_color": color} | {name: _file_map(values) for name, values in further.items()}
    if texture is not None and texture.shape[2] == 4:
        look["alpha"] = _file_map(texture[..., 3:])
    elif not part.opaque:
        look["alpha"] = _file_map(torch.as_tensor(part.alpha, dtype=torch.float32)[..., None])
    if "normal" in look and look["normal"].texture is None:  # a constant one is neutral: glTF has none
        del look["normal"]
    return look


def _file_map(values: Float[Tensor, "*shape"]) -> FileMap:
    if values.ndim == 1:
        return FileMap(tuple(values.tolist()))
    return FileMap((1.0,) * values.shape[-1], values.detach().cpu().numpy())


def _surface_attributes(
    surface: Surface, chosen: ndarray, tangents: Float[ndarray, "faces 3 4"] | None
) -> tuple[dict[str, ndarray], Int[ndarray, " corners"]]:
    """Attributes of the vertices of the chosen faces, split where tangents differ, and the corners' indices."""
    vertex, tangent = surface.faces[chosen].reshape(-1), None
    if tangents is None:
        used, corners = np.unique(vertex, return_inverse=True)
    else:
        rows, corners = merge_rows(np.column_stack([vertex, tangents[chosen].reshape(-1, 4)]))
        used, tangent = rows[:, 0].astype(np.int64), rows[:, 1:]
    attributes = {"POSITION": surface.positions[used], "NORMAL": surface.normals[used]}
    if tangent is not None:
        attributes["TANGENT"] = tangent
    return attributes | {"TEXCOORD_0": _top_left(surface.uv[used])}, corners.reshape(-1)


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


def _split_corners(
    mesh: Mesh, chosen: ndarray, sets: Iterable[int]
) -> tuple[dict[str, ndarray], Int[ndarray, " corners"]]:
    """Attributes of one vertex for each distinct position and UV of the chosen faces, and the corners' indices."""
    vertex = mesh.faces[chosen].reshape(-1)
    found = {f"TEXCOORD_{number}": uv for number in sets if (uv := mesh.uv_set(number)) is not None}
    split, faces = merge_rows(np.column_stack([vertex, *(uv[chosen].reshape(-1, 2) for uv in found.values())]))
    attributes = {"POSITION": mesh.positions[split[:, 0].astype(np.int64)]}
    for place, name in enumerate(found):
        attributes[name] = _top_left(split[:, 1 + 2 * place : 3 + 2 * place])
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


def _add_material(document: _Document, name: str, look: Mapping[str, FileMap]) -> int:
    """The index of the material with these maps: `base_color`, and those that the part has of `FILE_CHANNELS`."""
    color, alpha, normal = look["base_color"], look.get("alpha", FileMap((1.0,))), look.get("normal")
    pbr: dict[str, Any] = {"baseColorFactor": [*color.factor, *alpha.factor]}
    entry: dict[str, Any] = {"name": name, "pbrMetallicRoughness": pbr}
    if alpha.texture is not None:
        pbr["baseColorTexture"] = _add_texture(document, _color_png, (color, alpha), 3)
    elif color.texture is not None:
        pbr["baseColorTexture"] = _add_texture(document, _color_png, (color,), 3)
    pbr |= _gloss(document, look)
    if normal is not None and normal.texture is not None:
        picture = _add_texture(document, _normal_png, (normal,), 3)
        entry["normalTexture"] = picture if normal.factor[0] == 1.0 else picture | {"scale": normal.factor[0]}
    entry |= {"alphaMode": "OPAQUE", "doubleSided": True}
    if "alpha" in look:
        entry |= {"alphaMode": "BLEND"} if alpha.cutoff is None else {"alphaMode": "MASK", "alphaCutoff": alpha.cutoff}
    if "roughness" not in look:
        entry["extras"] = {LAMBERTIAN: True}
    document.materials.append(entry)
    return len(document.materials) - 1


def _gloss(document: _Document, look: Mapping[str, FileMap]) -> dict[str, Any]:
    """The keys of roughness and metallic."""
    if "roughness" not in look:
        return {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
    rough, metallic = look["roughness"], look.get("metallic", FileMap((0.0,)))
    keys: dict[str, Any] = {"metallicFactor": metallic.factor[0], "roughnessFactor": rough.factor[0]}
    if rough.texture is not None or metallic.texture is not None:
        keys["metallicRoughnessTexture"] = _add_texture(document, _gloss_png, (rough, metallic), 1)
    return keys


def _color_png(*textures: Texture) -> bytes:
    """RGB or RGBA, whose RGB is sRGB."""
    return texture_png(torch.cat(textures, dim=-1))


def _gloss_png(rough: Texture, metallic: Texture) -> bytes:
    """Roughness in green and metallic in blue, both linear."""
    return texture_png(torch.cat([torch.zeros_like(rough), rough, metallic], dim=-1), "raw")


def _normal_png(normal: Texture) -> bytes:
    return texture_png(0.5 + 0.5 * normal, "raw")


def _add_texture(
    document: _Document, encode: Callable[..., bytes], maps: tuple[FileMap, ...], channels: int
) -> dict[str, Any]:
    """glTF's `textureInfo` of the picture that holds these maps.

    Raises:
        AssetError: the maps differ in size, or in their UVs.
    """
    sets = {given.uv_set for given in maps if given.texture is not None}
    if len(sets) > 1:
        raise AssetError(f"textures that share a picture in GLB are over the UV sets {sorted(sets)}; wanted one set.")
    info, number = {"index": _add_image(document, encode, tuple(m.texture for m in maps), channels)}, max(sets)
    return info | {"texCoord": number} if number else info


def _add_image(
    document: _Document,
    encode: Callable[..., bytes],
    textures: tuple[Float[ndarray, "rows cols channels"] | None, ...],
    channels: int,
) -> int:
    """The index of the picture that `encode` makes of the textures; the same textures give one picture for all parts.

    Args:
        channels: of the first texture, if it is missing. A missing texture is 1 everywhere.

    Raises:
        AssetError: the textures that glTF keeps in one picture differ in size.
    """
    key = (encode, *(None if t is None else (t.ctypes.data, t.shape, t.strides) for t in textures))
    if key not in document.image_of:
        sizes = {texture.shape[:2] for texture in textures if texture is not None}
        if len(sizes) > 1:
            raise AssetError(f"textures that share a picture in GLB have the sizes {sorted(sizes)}; wanted one size.")
        ones = np.ones((*sizes.pop(), channels), np.float32)
        values = [torch.from_numpy(ones if t is None else np.ascontiguousarray(t)).float() for t in textures]
        view = _add_view(document, encode(*values))
        document.images.append({"bufferView": view, "mimeType": "image/png"})
        document.image_of[key] = len(document.images) - 1
        document.kept.append(textures)
    return document.image_of[key]


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
