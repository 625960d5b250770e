"""What a glTF header must look like before anything is made of it: types of all that the package reads."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_codecs.plain import COMPONENTS, DTYPES

_TABLES = (
    *("accessors", "bufferViews", "buffers", "images", "materials", "meshes", "nodes", "samplers", "scenes", "skins"),
    "textures",
)
_ATTRIBUTES: Mapping[str, tuple[str, ...]] = {
    "POSITION": ("VEC3",),
    "NORMAL": ("VEC3",),
    "TANGENT": ("VEC4", "VEC3"),
    "TEXCOORD": ("VEC2",),
    "COLOR": ("VEC3", "VEC4"),
    "JOINTS": ("VEC4",),
    "WEIGHTS": ("VEC4",),
}
"""The types of vertex attributes, by their names without a number. Tangents of morph targets lack the handedness."""

_MOST_SETS = 100
_SETS = frozenset(f"TEXCOORD_{number}" for number in range(_MOST_SETS))

_LISTS = ("children", "joints")
_REFERENCES: Mapping[str, Mapping[str, str]] = {
    "accessors": {"bufferView": "bufferViews"},
    "bufferViews": {"buffer": "buffers"},
    "images": {"bufferView": "bufferViews"},
    "nodes": {"mesh": "meshes", "skin": "skins", "children": "nodes"},
    "scenes": {"nodes": "nodes"},
    "skins": {"joints": "nodes", "inverseBindMatrices": "accessors"},
    "textures": {"sampler": "samplers"},
}
"""For each table, the keys whose numbers are places in another. Those of pictures may be wrong, which is a warning."""

_NUMBERS: Mapping[str, tuple[int, ...]] = {
    "matrix": (16,),
    "translation": (3,),
    "rotation": (4,),
    "scale": (3,),
}
"""Keys of nodes, and how many numbers they hold."""

_SCALARS = ("alphaCutoff", "strength", "emissiveStrength", "rotation")  # of materials
_MOST_NESTED = 100


def check_header(path: Path, header: Any) -> None:
    """Checks the types of what is read of a glTF header, and that its references lead somewhere.

    Raises:
        AssetError: the header is not glTF 2.0, or an entry is of another type than glTF's, says a number that is not
            finite, or names what does not exist.
    """
    if not isinstance(header, dict) or not isinstance(header.get("asset"), dict):
        raise AssetError(f"{path} is JSON but not glTF: it has no 'asset'.")
    version = header["asset"].get("version")
    if not (isinstance(version, str) and version.startswith("2.")):
        raise AssetError(f"{path} is glTF version {str(version)[:20]!r}; wanted version 2.")
    for name in _TABLES:
        entries = header.get(name, [])
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise AssetError(f"{path} cannot be read as glTF: its '{name}' is no list of objects.")
    for problem in _problems(header):
        raise AssetError(f"{path} cannot be read as glTF: {problem}.")


def _problems(header: dict[str, Any]) -> Iterator[str]:
    yield from _unusual(header, "it", 0)
    for table, references in _REFERENCES.items():
        for k, entry in enumerate(header.get(table, [])):
            for key, other in references.items():
                wanted = list if key in _LISTS or table == "scenes" else int
                if key in entry and not isinstance(entry[key], wanted):
                    yield f"{table}[{k}] has {key} of another type than glTF's"
                yield from _lost(entry, key, len(header.get(other, [])), f"{table}[{k}]")
    for k, entry in enumerate(header.get("accessors", [])):
        if entry.get("type") not in COMPONENTS or entry.get("componentType") not in DTYPES:
            yield f"accessors[{k}] is of no type of glTF's"
        if not _is_index(entry.get("count")) or not _is_index(entry.get("byteOffset", 0)):
            yield f"accessors[{k}] has a count or byteOffset that is no whole number"
    yield from _lost(header, "scene", max(1, len(header.get("scenes", []))), "it")
    for k, node in enumerate(header.get("nodes", [])):
        for key, counts in _NUMBERS.items():
            if key in node and not (_is_numbers(node[key]) and len(node[key]) in counts):
                yield f"nodes[{k}] has a {key} that is not of {counts[0]} numbers"
    accessors = header.get("accessors", [])
    for k, mesh in enumerate(header.get("meshes", [])):
        if not _is_numbers(mesh.get("weights", [])):
            yield f"meshes[{k}] has weights that are no numbers"
        for primitive in _objects(mesh.get("primitives")):
            if primitive is None:
                yield f"meshes[{k}] has primitives that are no list of objects"
                return
            yield from _primitive(primitive, accessors, len(header.get("materials", [])), f"meshes[{k}]")
    for k, material in enumerate(header.get("materials", [])):
        yield from _material(material, f"materials[{k}]")


def _primitive(primitive: dict[str, Any], accessors: list[Any], materials: int, where: str) -> Iterator[str]:
    yield from _lost(primitive, "material", materials, where)
    yield from _lost(primitive, "indices", len(accessors), where)
    if "indices" in primitive and accessors[primitive["indices"]]["type"] != "SCALAR":
        yield f"{where} has indices of {accessors[primitive['indices']]['type']}"
    for attributes in (primitive.get("attributes"), *_objects(primitive.get("targets", []))):
        if not isinstance(attributes, dict):
            yield f"{where} has a primitive whose attributes are no object"
            return
        for name, index in attributes.items():
            yield from _lost(attributes, name, len(accessors), where)
            kind, wanted = accessors[index]["type"], _ATTRIBUTES.get(name.split("_")[0], tuple(COMPONENTS))
            if name.startswith("TEXCOORD_") and name not in _SETS:
                yield f"{where} has a {name[:20]!r}; wanted TEXCOORD_0 to TEXCOORD_{_MOST_SETS - 1}"
            if kind not in wanted:
                yield f"{where} has a {name} of {kind}; wanted {wanted[0]}"


def _material(entry: dict[str, Any], where: str) -> Iterator[str]:
    """What is wrong in a material or in an object within it; by the endings of glTF's and its extensions' keys."""
    for key, value in entry.items():
        if key in ("extras", "name"):
            continue
        if key.endswith("Texture"):
            if not isinstance(value, dict) or not _is_index(value.get("index")):
                yield f"{where} has a {key} without an index"
                continue
            if not _is_index(value.get("texCoord", 0)):
                yield f"{where} has a {key} whose texCoord is no number of a set"
        elif key.endswith("Factor"):
            yield from _factor(key, value, where)
        elif (key in _SCALARS or (key == "scale" and where.endswith("Texture"))) and not _is_number(value):
            yield f"{where} has a {key} that is no number"
        elif key in ("scale", "offset") and where.endswith(".KHR_texture_transform"):
            if not _is_numbers(value) or len(value) != 2:
                yield f"{where} has a {key} that is not two numbers"
        elif key in ("pbrMetallicRoughness", "extensions") and not isinstance(value, dict):
            yield f"{where} has a {key} that is no object"
        if isinstance(value, dict):
            yield from _material(value, f"{where}.{key}")


def _factor(key: str, value: Any, where: str) -> Iterator[str]:
    count = 4 if key in ("baseColorFactor", "diffuseFactor") else 3 if "Color" in key or key == "emissiveFactor" else 1
    wanted = {count, 3} if key == "specularFactor" else {count}  # of two extensions
    given = 1 if _is_number(value) else len(value) if _is_numbers(value) and len(value) > 1 else 0
    if given not in wanted:
        yield f"{where} has a {key} that is not {count} finite {'number' if count == 1 else 'numbers'}"


def _unusual(value: Any, where: str, depth: int) -> Iterator[str]:
    """Numbers that are not finite, which JSON does not know, and objects nested without reason."""
    if depth > _MOST_NESTED:
        yield "its JSON is nested too deeply"
        return
    if isinstance(value, dict):
        if "extensions" in value and not (
            isinstance(value["extensions"], dict) and all(isinstance(e, dict) for e in value["extensions"].values())
        ):
            yield f"{where} has extensions that are no objects"
        for key, each in value.items():
            if isinstance(each, dict | list | float):
                yield from _unusual(each, key, depth + 1)
    elif isinstance(value, list):
        for each in value:
            if isinstance(each, dict | list | float):
                yield from _unusual(each, where, depth + 1)
    elif isinstance(value, float) and not math.isfinite(value):
        yield f"a number of '{where}' is {value}, which is not finite"


def _lost(entry: dict[str, Any], key: str, count: int, where: str) -> Iterator[str]:
    """The reference, or the first of several, that leads nowhere."""
    if key in entry:
        for value in entry[key] if isinstance(entry[key], list) else [entry[key]]:
            if not _is_index(value) or value >= count:
                yield f"{where} names {key} {str(value)[:20]!r} of {count}"
                return


def _objects(value: Any) -> list[Any]:
    """The objects of a list; None stands for what is no object, and for what is no list."""
    return [e if isinstance(e, dict) else None for e in value] if isinstance(value, list) else [None]


def _is_index(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= 0


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= 1e30


def _is_numbers(value: Any) -> bool:
    return isinstance(value, list) and all(map(_is_number, value))
