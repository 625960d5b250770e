"""Write GLB files: surfaces with their generated textures, and unchanged meshes."""

from __future__ import annotations

import os
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
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document, Json, write_document
from svbrdfgan.io.gltf.materials import LAMBERTIAN
from svbrdfgan.io.gltf_codecs.plain import INDICES
from svbrdfgan.io.image import texture_png
from svbrdfgan.io.rows import members, merge_rows
from svbrdfgan.types import FileMap, Mesh, Part, Surface
from svbrdfgan.types.geometry import FILE_CHANNELS

Texture = Float[Tensor, "rows cols channels"]

# Constants of the glTF 2.0 specification (OpenGL enumerants).
LINEAR = 9729  # filter of samplers
CLAMP = 33071  # wrapping of samplers
REPEAT = 10497

ROUGHNESS = 0.9
"""The roughness with which viewers show parts without gloss, which glTF does not know."""


@dataclass
class _Builder:
    """A document under construction, and the pictures that it has so far.

    Attributes:
        sampler: how textures are filtered and wrapped.
        kept: the textures whose addresses are keys of `image_of`, so that no other takes their place in memory.
    """

    document: Document
    sampler: Json
    image_of: dict[tuple[Any, ...], int] = field(default_factory=dict)
    kept: list[Any] = field(default_factory=list)

    @classmethod
    def at(cls, path: str | os.PathLike[str], repeat: tuple[bool, bool]) -> _Builder:
        """An empty document for a file, whose textures repeat in u and in v."""
        wrap_u, wrap_v = (REPEAT if repeats else CLAMP for repeats in repeat)
        header: Json = {"asset": {"version": "2.0", "generator": "svbrdfgan"}, "scene": 0, "scenes": [{"nodes": []}]}
        sampler = {"magFilter": LINEAR, "minFilter": LINEAR, "wrapS": wrap_u, "wrapT": wrap_v}
        return cls(Document(header, [], Path(path)), sampler)


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
    builder = _Builder.at(path, surface.repeat)
    for index, chosen in enumerate(members(surface.face_part, len(surface.parts))):
        if len(chosen):
            part = surface.parts[index]
            look = _surface_maps(part, textures.get(index), maps.get(index, {}))
            material = _add_material(builder, part.name, look)
            framed = tangents if "normal" in look else None
            _add_mesh(builder.document, part.name, *_surface_attributes(surface, chosen, framed), material)
    write_document(path, builder.document)


def save_mesh_glb(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Writes a mesh as GLB. `load_mesh` returns the same triangles, parts and UVs (positions rounded to float32).

    Raises:
        AssetError: the suffix is not .glb, or the file cannot be written.
    """
    _check_suffix(path)
    write_document(path, mesh_document(path, mesh))


def mesh_document(path: str | os.PathLike[str], mesh: Mesh) -> Document:
    """The document of a mesh, with one node, one mesh and one material for each part.

    No normals are stored: viewers shade the mesh flat, and this package computes its own normals.

    Args:
        path: of the file that it is or will be.
    """
    builder = _Builder.at(path, (True, True))
    for part, chosen in zip(mesh.parts, members(mesh.face_part, len(mesh.parts)), strict=True):
        if len(chosen):
            look = {name: _over(mesh, given) for name, given in part.all_maps.items()}
            if "normal" in look and look["normal"].texture is None:
                del look["normal"]
            material = _add_material(builder, part.name, look)
            sets = range(1 + max((given.uv_set for given in look.values() if given.texture is not None), default=0))
            _add_mesh(builder.document, part.name, *_split_corners(mesh, chosen, sets), material)
    return builder.document


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


def _add_mesh(
    document: Document, name: str, attributes: Mapping[str, ndarray], faces: Int[ndarray, "*corners"], material: int
) -> None:
    primitive = {
        "attributes": {
            key: append_accessor(document, array.astype("<f4"), bounds=array.shape[1] == 3)
            for key, array in attributes.items()
        },
        "indices": append_accessor(document, faces.reshape(-1).astype("<u4"), target=INDICES),
        "material": material,
    }
    mesh = document.add("meshes", {"name": name, "primitives": [primitive]})
    document.header["scenes"][0]["nodes"].append(document.add("nodes", {"name": name, "mesh": mesh}))


def _add_material(builder: _Builder, name: str, look: Mapping[str, FileMap]) -> int:
    """The index of the material with these maps: `base_color`, and those that the part has of `FILE_CHANNELS`."""
    color, alpha, normal = look["base_color"], look.get("alpha", FileMap((1.0,))), look.get("normal")
    pbr: dict[str, Any] = {"baseColorFactor": [*color.factor, *alpha.factor]}
    entry: dict[str, Any] = {"name": name, "pbrMetallicRoughness": pbr}
    if alpha.texture is not None:
        pbr["baseColorTexture"] = _add_texture(builder, _color_png, (color, alpha), 3)
    elif color.texture is not None:
        pbr["baseColorTexture"] = _add_texture(builder, _color_png, (color,), 3)
    pbr |= _gloss(builder, look)
    if normal is not None and normal.texture is not None:
        picture = _add_texture(builder, _normal_png, (normal,), 3)
        entry["normalTexture"] = picture if normal.factor[0] == 1.0 else picture | {"scale": normal.factor[0]}
    entry |= {"alphaMode": "OPAQUE", "doubleSided": True}
    if "alpha" in look:
        entry |= {"alphaMode": "BLEND"} if alpha.cutoff is None else {"alphaMode": "MASK", "alphaCutoff": alpha.cutoff}
    if "roughness" not in look:
        entry["extras"] = {LAMBERTIAN: True}
    return builder.document.add("materials", entry)


def _gloss(builder: _Builder, look: Mapping[str, FileMap]) -> dict[str, Any]:
    """The keys of roughness and metallic."""
    if "roughness" not in look:
        return {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
    rough, metallic = look["roughness"], look.get("metallic", FileMap((0.0,)))
    keys: dict[str, Any] = {"metallicFactor": metallic.factor[0], "roughnessFactor": rough.factor[0]}
    if rough.texture is not None or metallic.texture is not None:
        keys["metallicRoughnessTexture"] = _add_texture(builder, _gloss_png, (rough, metallic), 1)
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
    builder: _Builder, encode: Callable[..., bytes], maps: tuple[FileMap, ...], channels: int
) -> dict[str, Any]:
    """glTF's `textureInfo` of the picture that holds these maps.

    Raises:
        AssetError: the maps differ in size, or in their UVs.
    """
    sets = {given.uv_set for given in maps if given.texture is not None}
    if len(sets) > 1:
        raise AssetError(f"textures that share a picture in GLB are over the UV sets {sorted(sets)}; wanted one set.")
    info, number = {"index": _add_picture(builder, encode, tuple(m.texture for m in maps), channels)}, max(sets)
    return info | {"texCoord": number} if number else info


def _add_picture(
    builder: _Builder,
    encode: Callable[..., bytes],
    textures: tuple[Float[ndarray, "rows cols channels"] | None, ...],
    channels: int,
) -> int:
    """The index of the texture whose picture `encode` makes; the same arguments give the same texture.

    Args:
        channels: of the first texture, if it is missing. A missing texture is 1 everywhere.

    Raises:
        AssetError: the textures that glTF keeps in one picture differ in size.
    """
    key = (encode, *(None if t is None else (t.ctypes.data, t.shape, t.strides) for t in textures))
    if key not in builder.image_of:
        sizes = {texture.shape[:2] for texture in textures if texture is not None}
        if len(sizes) > 1:
            raise AssetError(f"textures that share a picture in GLB have the sizes {sorted(sizes)}; wanted one size.")
        ones = np.ones((*sizes.pop(), channels), np.float32)
        values = [torch.from_numpy(ones if t is None else np.ascontiguousarray(t)).float() for t in textures]
        document = builder.document
        view = document.add_view(encode(*values))
        image = document.add("images", {"bufferView": view, "mimeType": "image/png"})
        if "samplers" not in document.header:
            document.add("samplers", builder.sampler)
        builder.image_of[key] = document.add("textures", {"sampler": 0, "source": image})
        builder.kept.append(textures)
    return builder.image_of[key]
