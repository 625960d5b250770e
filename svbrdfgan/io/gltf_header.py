"""Read the JSON of a glTF or GLB file: checks before a mesh library loads it, and what it drops of materials."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.errors import AssetError

MAX_ACCESSOR = 150_000_000
"""Elements per accessor: the corners of 50 million triangles. A header that claims more is broken; the mesh library
would allocate memory for it without a check."""

LAMBERTIAN = "lambertian"
"""The key in a material's `extras` by which files of this package mark parts without gloss: glTF knows no such part."""

UNREADABLE = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization")
"""Extensions that change the encoding of the geometry, and that the mesh library does not support."""


@dataclass(frozen=True)
class HeaderMaterial:
    """What the mesh library rounds or drops of a material.

    Attributes:
        name: need not be unique.
        base_color: linear, in full precision.
        alpha: of the base colour, in full precision.
        roughness, metallic: factors.
        normal_scale: multiplies x and y of the normal texture.
        textures: keys of the textures that the material names.
        lambertian: whether this package wrote the material for a part that has no gloss.
    """

    name: str | None
    base_color: tuple[float, float, float]
    alpha: float
    roughness: float
    metallic: float
    normal_scale: float
    textures: frozenset[str]
    lambertian: bool


def read_materials(path: Path) -> tuple[HeaderMaterial, ...]:
    """The materials of a .gltf or .glb file, after checks of its header.

    Raises:
        AssetError: the file is truncated, is not glTF 2.0, or encodes its geometry in a way that is not supported.
    """
    header = _glb_json(path) if path.suffix.lower() == ".glb" else _json(path, path.read_bytes())
    used = [name for name in UNREADABLE if name in header.get("extensionsRequired", [])]
    if used:
        raise AssetError(
            f"{path} needs the glTF extension {used[0]}, which cannot be read; export it without compression."
        )
    _check_accessors(path, header)
    return tuple(_material(material) for material in header.get("materials", []))


def _glb_json(path: Path) -> dict[str, Any]:
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(20)
        if head[:4] != b"glTF":
            raise AssetError(f"{path} is not a GLB file: it does not begin with 'glTF'.")
        if len(head) < 20:
            raise AssetError(f"{path} is cut short: it has {size} bytes; export or download it again.")
        version, length, chunk = struct.unpack("<III", head[4:16])
        if version != 2:
            raise AssetError(f"{path} is glTF version {version}; wanted version 2.")
        if length > size or chunk > size - 20:
            raise AssetError(
                f"{path} is cut short: it has {size} of {max(length, chunk + 20)} bytes; export or download it again."
            )
        return _json(path, file.read(chunk))


def _json(path: Path, text: bytes) -> dict[str, Any]:
    try:
        header = json.loads(text)
    except ValueError as error:
        raise AssetError(f"{path} cannot be read as glTF: its JSON is broken ({error}).") from error
    if not isinstance(header, dict) or "asset" not in header:
        raise AssetError(f"{path} is JSON but not glTF: it has no 'asset'.")
    return header


def _check_accessors(path: Path, header: dict[str, Any]) -> None:
    accessors = header.get("accessors", [])
    largest = max((accessor["count"] for accessor in accessors), default=0)
    if largest > MAX_ACCESSOR:
        raise AssetError(f"{path} claims {largest} elements in one accessor; wanted at most {MAX_ACCESSOR}.")
    for mesh in header.get("meshes", []):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            texcoord = attributes.get("TEXCOORD_0")
            if texcoord is not None and accessors[texcoord]["componentType"] != 5126:
                raise AssetError(f"{path} stores texture coordinates as integers; export them as floats.")
            indices = [primitive.get("indices"), attributes.get("POSITION"), texcoord]
            if any(index is not None and "sparse" in accessors[index] for index in indices):
                raise AssetError(f"{path} stores its geometry in sparse accessors; export it without them.")


def _material(material: dict[str, Any]) -> HeaderMaterial:
    pbr = material.get("pbrMetallicRoughness", {})
    red, green, blue, alpha = (float(value) for value in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)))
    extras = material.get("extras")
    return HeaderMaterial(
        name=material.get("name"),
        base_color=(red, green, blue),
        alpha=alpha,
        roughness=float(pbr.get("roughnessFactor", 1.0)),
        metallic=float(pbr.get("metallicFactor", 1.0)),
        normal_scale=float(material.get("normalTexture", {}).get("scale", 1.0)),
        textures=frozenset(key for key in (*pbr, *material) if key.endswith("Texture")),
        lambertian=isinstance(extras, dict) and extras.get(LAMBERTIAN) is True,
    )
