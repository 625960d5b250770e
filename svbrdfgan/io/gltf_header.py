"""Read the JSON of a glTF or GLB file: checks before a mesh library loads it, and what it would drop of materials."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from svbrdfgan.errors import AssetError
from svbrdfgan.io.uv_sets import UVSet

MAX_ACCESSOR = 150_000_000
"""Elements per accessor: the corners of 50 million triangles. A header that claims more is broken; the mesh library
would allocate memory for it without a check."""

LAMBERTIAN = "lambertian"
"""The key in a material's `extras` by which files of this package mark parts without gloss: glTF knows no such part."""

TEXTURES = ("baseColorTexture", "metallicRoughnessTexture", "normalTexture")
"""The textures that are read."""

UNREADABLE = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization")
"""Extensions that change the encoding of the geometry, and that the mesh library does not support."""

UV_ATTRIBUTE = "_TEXCOORD_{}"
"""The name under which the mesh library is given further texture coordinates, which it would drop by their own name."""


@dataclass(frozen=True)
class HeaderMaterial:
    """The values of a material that the mesh library rounds or drops.

    Attributes:
        name: need not be unique.
        base_color: linear, in full precision.
        alpha: of the base colour, in full precision.
        normal_scale: multiplies x and y of the normal texture.
        textures: by key, where the textures that the material names are looked up.
        lambertian: whether this package wrote the material for a part that has no gloss.
    """

    name: str | None
    base_color: tuple[float, float, float]
    alpha: float
    normal_scale: float
    textures: Mapping[str, UVSet]
    lambertian: bool


def read_header(path: Path) -> dict[str, Any]:
    """The JSON of a .gltf or .glb file, checked.

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
    return header


def read_materials(header: dict[str, Any]) -> tuple[HeaderMaterial, ...]:
    """The materials of a file with this header."""
    return tuple(_material(material) for material in header.get("materials", []))


def readable(path: Path, header: dict[str, Any]) -> BytesIO:
    """The file as the mesh library is to read it: with each material's index as its name, and all UVs.

    From the file itself, the library would drop which material is which, and all texture coordinates but the first.
    """
    materials = [{**material, "name": str(index)} for index, material in enumerate(header.get("materials", []))]
    meshes = [
        {**mesh, "primitives": [{**p, "attributes": _renamed(p["attributes"])} for p in mesh["primitives"]]}
        for mesh in header.get("meshes", [])
    ]
    text = json.dumps({**header, "materials": materials, "meshes": meshes}).encode()
    if path.suffix.lower() != ".glb":
        return BytesIO(text)
    data = path.read_bytes()
    text += b" " * (-len(text) % 4)
    rest = data[20 + struct.unpack("<I", data[12:16])[0] :]
    head = struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text) + len(rest), len(text), b"JSON")
    return BytesIO(head + text + rest)


def _renamed(attributes: dict[str, Any]) -> dict[str, Any]:
    sets = (key for key in attributes if key.startswith("TEXCOORD_") and key != "TEXCOORD_0")
    further = {key: UV_ATTRIBUTE.format(key.removeprefix("TEXCOORD_")) for key in sets}
    return {further.get(key, key): index for key, index in attributes.items()}


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
    used = {uv_set.number for material in read_materials(header) for uv_set in material.textures.values()} | {0}
    largest = max((accessor["count"] for accessor in accessors), default=0)
    if largest > MAX_ACCESSOR:
        raise AssetError(f"{path} claims {largest} elements in one accessor; wanted at most {MAX_ACCESSOR}.")
    for mesh in header.get("meshes", []):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            texcoords = [attributes[f"TEXCOORD_{n}"] for n in used if f"TEXCOORD_{n}" in attributes]
            if any(accessors[texcoord]["componentType"] != 5126 for texcoord in texcoords):
                raise AssetError(f"{path} stores texture coordinates as integers; export them as floats.")
            indices = [primitive.get("indices"), attributes.get("POSITION"), *texcoords]
            if any(index is not None and "sparse" in accessors[index] for index in indices):
                raise AssetError(f"{path} stores its geometry in sparse accessors; export it without them.")


def _material(material: dict[str, Any]) -> HeaderMaterial:
    pbr = material.get("pbrMetallicRoughness", {})
    red, green, blue, alpha = (float(value) for value in pbr.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)))
    extras = material.get("extras")
    return HeaderMaterial(
        name=name if isinstance(name := material.get("name"), str) else None,
        base_color=(red, green, blue),
        alpha=alpha,
        normal_scale=float(material.get("normalTexture", {}).get("scale", 1.0)),
        textures={key: UVSet.of(info) for key, info in (pbr | material).items() if key in TEXTURES},
        lambertian=isinstance(extras, dict) and extras.get(LAMBERTIAN) is True,
    )
