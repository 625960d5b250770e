"""A glTF document with something of everything, in pieces that tests change, and the ways to pack it into files."""

import base64
import json
import struct
from collections.abc import Callable
from copy import deepcopy
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Num
from numpy import ndarray

Pieces = dict[str, Any]
"""The JSON of a document, whose accessors have their `array` and whose images have their `bytes`."""
KINDS = {"f4": 5126, "u1": 5121, "u2": 5123, "u4": 5125}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
PNG = b"\x89PNG\r\n\x1a\n"


def _arrays() -> list[Num[ndarray, "count width"]]:
    random = np.random.default_rng(5)

    def floats(count: int, width: int) -> Num[ndarray, "count width"]:
        return random.random((count, width), dtype="f4")

    indices = np.array([0, 1, 2, 2, 1, 3], "u2").reshape(-1, 1)
    joints = random.integers(0, 2, (4, 4)).astype("u1")
    weights = np.full((4, 4), 63, "u1")
    vertices = [floats(4, 3), floats(4, 3), floats(4, 2), floats(4, 2), indices]
    skinned = [joints, weights, floats(2, 16), floats(4, 3), floats(3, 1), floats(3, 3), floats(3, 1)]
    return [*vertices, *skinned, floats(2, 3)]


def _material(name: str, **more: Any) -> Pieces:
    return {"name": name, "pbrMetallicRoughness": {"roughnessFactor": 0.5}, **more}


MATERIALS = [
    _material(
        "Paint",
        doubleSided=True,
        normalTexture={"index": 1, "texCoord": 1, "scale": 0.5},
        pbrMetallicRoughness={
            "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}},
            "roughnessFactor": 0.4,
        },
        extensions={"KHR_materials_clearcoat": {"clearcoatTexture": {"index": 1}}, "ACME_rust": {"level": 3}},
        extras={"colour code": "LY3D"},
    ),
    _material("Glass", alphaMode="BLEND", extensions={"KHR_materials_unlit": {}}),
    _material("Blue"),
    _material("Spare"),
]
VARIANTS = {"mappings": [{"material": 0, "variants": [0]}, {"material": 2, "variants": [1]}]}
BODY = {
    "name": "Body",
    "primitives": [
        {
            "attributes": {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "TEXCOORD_1": 3},
            "indices": 4,
            "material": 0,
            "extensions": {"KHR_materials_variants": VARIANTS},
        },
        {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "mode": 5, "material": 1, "extras": {"lod": 1}},
    ],
    "extras": {"part": "shell"},
}
DRIVER = {
    "name": "Driver",
    "weights": [0.5],
    "primitives": [
        {
            "attributes": {"POSITION": 0, "JOINTS_0": 5, "WEIGHTS_0": 6},
            "indices": 4,
            "targets": [{"POSITION": 8}],
            "material": 1,
        }
    ],
}
WHEEL = {"name": "Wheel", "primitives": [{"attributes": {"POSITION": 0}, "indices": 4}]}
NODES = [
    {"name": "Car", "mesh": 0, "children": [1, 2, 3], "extras": {"owner": "A"}},
    {"name": "Wheel.L", "mesh": 1, "translation": [1, 0, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
    {"name": "Wheel.R", "mesh": 1, "rotation": [0, 0, 0, 1], "extensions": {"ACME_door": {"opens": True}}},
    {"name": "Camera", "camera": 0},
    {"name": "Root", "children": [5]},
    {"name": "Bone"},
    {"name": "Driver", "mesh": 2, "skin": 0, "weights": [0.25]},
    {"name": "Loose", "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 12}}}, "mesh": 1},
]
POINTER = {"KHR_animation_pointer": {"pointer": "/materials/0/pbrMetallicRoughness/roughnessFactor"}}
ANIMATION = {
    "name": "Drive",
    "samplers": [{"input": 9, "output": 10, "interpolation": "STEP"}, {"input": 9, "output": 11}],
    "channels": [
        {"sampler": 0, "target": {"node": 1, "path": "translation"}},
        {"sampler": 1, "target": {"path": "pointer", "extensions": POINTER}},
    ],
}
SPOT = {"type": "spot", "spot": {"outerConeAngle": 0.5}, "name": "Head light"}
USED = ("KHR_lights_punctual", "KHR_materials_variants", "KHR_materials_clearcoat", "KHR_texture_transform")


def sample_document() -> Pieces:
    """The pieces of the document; new ones each time."""
    root: Pieces = {
        "asset": {"version": "2.0", "generator": "Hand", "copyright": "CC0", "extras": {"author": "B"}},
        "scene": 0,
        "scenes": [{"name": "Scene", "nodes": [0, 4, 6], "extras": {"floor": 0}}],
        "nodes": NODES,
        "meshes": [BODY, WHEEL, DRIVER],
        "materials": MATERIALS,
        "textures": [
            {"sampler": 0, "source": 0, "name": "Base"},
            {"source": 1, "extensions": {"EXT_texture_webp": {"source": 2}}},
        ],
        "samplers": [{"wrapS": 33071, "magFilter": 9728}],
        "images": [{"name": f"Image {i}", "bytes": PNG + bytes([i] * 5)} for i in range(4)],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}],
        "skins": [{"joints": [4, 5], "skeleton": 4, "inverseBindMatrices": 7, "name": "Rig"}],
        "animations": [ANIMATION],
        "accessors": [{"array": array} for array in _arrays()],
        "extensions": {
            "KHR_lights_punctual": {"lights": [SPOT, {"type": "point"}]},
            "KHR_materials_variants": {"variants": [{"name": "Red"}, {"name": "Blue"}]},
            "ACME_fleet": {"number": 7},
        },
        "extensionsUsed": [*USED, "EXT_mesh_gpu_instancing", "EXT_texture_webp", "ACME_fleet"],
        "extensionsRequired": ["EXT_mesh_gpu_instancing"],
        "extras": {"note": "mine"},
    }
    root["accessors"][6]["normalized"] = True
    root["accessors"][0]["name"] = "corners"
    return deepcopy(root)


def _described(accessor: Pieces, view: int, start: int = 0) -> Pieces:
    array = accessor["array"]
    kept = {key: value for key, value in accessor.items() if key != "array"}
    kind = {"componentType": KINDS[array.dtype.str[1:]], "count": len(array), "type": TYPES[array.shape[1]]}
    return {**kept, **kind, "bufferView": view, "byteOffset": start}


def _padded(data: bytes, fill: bytes = b"\0") -> bytes:
    return data + fill * (-len(data) % 4)


class Buffer:
    """Bytes with views into them, as they grow."""

    def __init__(self) -> None:
        self.data = b""
        self.views: list[Pieces] = []

    def add(self, data: bytes, **more: int) -> int:
        """The number of a new view of these bytes."""
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **more})
        self.data += _padded(data)
        return len(self.views) - 1


def separate(accessors: list[Pieces], buffer: Buffer) -> list[Pieces]:
    """Each accessor in a view of its own."""
    return [_described(accessor, buffer.add(accessor["array"].tobytes())) for accessor in accessors]


def interleaved(accessors: list[Pieces], buffer: Buffer) -> list[Pieces]:
    """Neighbouring accessors of floats and as many elements share a view."""
    described = []
    for _, group in groupby(accessors, lambda accessor: (len(accessor["array"]), accessor["array"].dtype.kind)):
        together = list(group)
        columns = [_padded_rows(accessor["array"]) for accessor in together]
        rows = np.concatenate(columns, axis=1)
        view = buffer.add(rows.tobytes(), byteStride=rows.shape[1])
        starts = np.cumsum([0, *(column.shape[1] for column in columns)])
        described += [_described(accessor, view, int(start)) for accessor, start in zip(together, starts, strict=False)]
    return described


def _padded_rows(array: Num[ndarray, "count width"]) -> Num[ndarray, "count bytes"]:
    rows = np.ascontiguousarray(array).view("u1").reshape(len(array), -1)
    return np.pad(rows, ((0, 0), (0, -rows.shape[1] % 4)))


def sparse(accessors: list[Pieces], buffer: Buffer) -> list[Pieces]:
    """All rows of each accessor are written over zeros."""
    described = []
    for accessor in accessors:
        indices = buffer.add(np.arange(len(accessor["array"]), dtype="u2").tobytes())
        values = buffer.add(accessor["array"].tobytes())
        stored = {"count": len(accessor["array"]), "indices": {"bufferView": indices, "componentType": 5123}}
        entry = _described(accessor, 0) | {"sparse": {**stored, "values": {"bufferView": values}}}
        described.append({key: value for key, value in entry.items() if key not in ("bufferView", "byteOffset")})
    return described


def write(pieces: Pieces, path: Path, arrange: Callable[[list[Pieces], Buffer], list[Pieces]] = separate) -> Path:
    """A .glb, a .gltf with files beside it, or (if it is called so) one with `data` URIs, from the pieces."""
    buffer = Buffer()
    accessors = arrange(pieces["accessors"], buffer)
    images = [_image(image, index, path, buffer) for index, image in enumerate(pieces["images"])]
    whole = {**pieces, "accessors": accessors, "images": images, "bufferViews": buffer.views}
    if path.suffix == ".glb":
        text = _padded(json.dumps({**whole, "buffers": [{"byteLength": len(buffer.data)}]}).encode(), b" ")
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(buffer.data), b"BIN\0")
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks) + len(buffer.data)) + chunks + buffer.data)
        return path
    uri = _uri(buffer.data, f"{path.stem} buffer.bin", path)
    path.write_text(json.dumps({**whole, "buffers": [{"uri": uri, "byteLength": len(buffer.data)}]}))
    return path


def _image(image: Pieces, index: int, path: Path, buffer: Buffer) -> Pieces:
    kept = {key: value for key, value in image.items() if key != "bytes"}
    if path.suffix == ".glb":
        return {**kept, "bufferView": buffer.add(image["bytes"]), "mimeType": "image/png"}
    return {**kept, "uri": _uri(image["bytes"], f"image {index}.png", path)}


def _uri(data: bytes, name: str, path: Path) -> str:
    if path.stem == "data":
        return "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    (path.parent / name).write_bytes(data)
    return name.replace(" ", "%20")
