"""The kinds with their seeds, made in a folder: a small data set, and glTF files with something of everything."""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.generate import generate
from tests.fuzz.kinds import Kind, kinds
from tests.fuzz.stored import stored_kinds
from tests.fuzz.trees import packed_glb

_FLOAT, _BYTE, _SHORT = 5126, 5121, 5123
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_COMPONENTS = {"f4": _FLOAT, "u1": _BYTE, "u2": _SHORT}

_PAINT = {
    "name": "paint",
    "pbrMetallicRoughness": {
        "baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": {"scale": [2, 2], "rotation": 0.1}}},
        "metallicRoughnessTexture": {"index": 0, "texCoord": 1},
        "baseColorFactor": [1, 0.5, 0.5, 1],
        "roughnessFactor": 0.4,
    },
    "normalTexture": {"index": 0, "scale": 0.5},
    "occlusionTexture": {"index": 0, "strength": 0.5},
    "emissiveTexture": {"index": 0},
    "emissiveFactor": [0.1, 0.1, 0.1],
    "extensions": {
        "KHR_materials_clearcoat": {"clearcoatFactor": 0.5, "clearcoatTexture": {"index": 0}},
        "KHR_materials_sheen": {"sheenColorFactor": [0.1, 0.1, 0.1], "sheenColorTexture": {"index": 0}},
        "KHR_materials_specular": {"specularFactor": 0.5, "specularTexture": {"index": 0}},
        "KHR_materials_transmission": {"transmissionFactor": 0.5},
    },
}
_OLD = {
    "name": "old",
    "alphaMode": "MASK",
    "alphaCutoff": 0.4,
    "extensions": {
        "KHR_materials_pbrSpecularGlossiness": {
            "diffuseFactor": [0.5, 0.5, 0.5, 0.9],
            "glossinessFactor": 0.3,
            "diffuseTexture": {"index": 0},
            "specularGlossinessTexture": {"index": 0},
        }
    },
}


def all_kinds(folder: Path) -> dict[str, Kind]:
    """All kinds; `folder` is filled with what they need."""
    data = {
        "image": [16, 16],
        "texture": 16,
        "spp": 1,
        "renderer": {"name": "numpy"},
        "embedding": {"name": "hemispherical", "resolution": 16},
        "environments": {"procedural": {"count": 1, "seed": 1}},
        "environment_rows": 8,
        "splits": {"train": {"meshes": {"procedural": {"count": 1, "seed": 1}}, "views": 1}},
    }
    generate(dataset_config(data, "seed"), folder / "dataset", base=folder)
    files = folder / "files"
    files.mkdir()
    return kinds(files, folder / "dataset", samples()) | stored_kinds(files)


def samples() -> dict[str, bytes]:
    """A GLB and a glTF with textures, extensions, a skin, a morph target, vertex colours, and instances."""
    header, binary = _document()
    chunk = len(binary).to_bytes(4, "little") + b"BIN\0" + binary
    from base64 import b64encode

    uri = "data:application/octet-stream;base64," + b64encode(binary).decode()
    whole = {**header, "buffers": [{"byteLength": len(binary), "uri": uri}]}
    return {".glb": packed_glb(json.dumps(header).encode(), chunk), ".gltf": json.dumps(whole).encode()}


def _document() -> tuple[dict[str, Any], bytes]:
    random = np.random.default_rng(5)
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-0.5, 0.5) for z in (-2, 2)], "f4")
    faces = [0, 1, 3, 0, 3, 2, 4, 6, 7, 4, 7, 5, 0, 4, 5, 0, 5, 1, 2, 3, 7, 2, 7, 6, 0, 2, 6, 0, 6, 4, 1, 5, 7, 1, 7, 3]
    arrays = [
        corners,
        random.random((8, 2), "f4"),
        random.random((8, 2), "f4"),
        np.array(faces, "u2").reshape(-1, 1),
        np.full((8, 4), 200, "u1"),
        np.zeros((8, 4), "u1"),
        np.full((8, 4), 0.25, "f4"),
        np.eye(4, dtype="f4").reshape(1, 16),
        0.1 * corners,
        np.array([[0, 0, 0], [3, 0, 0]], "f4"),
    ]
    stream = BytesIO()
    Image.fromarray(random.integers(0, 255, (8, 8, 4), "u1")).save(stream, "PNG")
    pieces = [array.tobytes() for array in arrays] + [stream.getvalue()]
    views, binary = [], b""
    for piece in pieces:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(piece)})
        binary += piece + b"\0" * (-len(piece) % 4)
    accessors: list[dict[str, Any]] = [
        {
            "bufferView": k,
            "componentType": _COMPONENTS[array.dtype.str[1:]],
            "count": len(array),
            "type": _TYPES[array.shape[1]],
        }
        for k, array in enumerate(arrays)
    ]
    accessors[4]["normalized"] = True
    accessors[8]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": 3, "componentType": _SHORT},
        "values": {"bufferView": 0},
    }
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 2}
    skinned = {"POSITION": 0, "COLOR_0": 4, "JOINTS_0": 5, "WEIGHTS_0": 6, "TEXCOORD_0": 1}
    header = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 2]}],
        "nodes": [
            {"name": "car", "mesh": 0, "children": [1], "translation": [0, 1, 0]},
            {
                "name": "wheel",
                "mesh": 1,
                "rotation": [0, 0, 0, 1],
                "scale": [1, 1, -1],
                "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": 9}}},
            },
            {"name": "driver", "mesh": 1, "skin": 0},
        ],
        "meshes": [
            {"name": "body", "primitives": [{"attributes": attributes, "indices": 3, "material": 0}]},
            {
                "name": "other",
                "weights": [0.5],
                "primitives": [
                    {"attributes": skinned, "indices": 3, "material": 1, "targets": [{"POSITION": 8}]},
                    {"attributes": {"POSITION": 0, "COLOR_0": 4}, "mode": 5},
                ],
            },
        ],
        "materials": [_PAINT, _OLD],
        "textures": [{"sampler": 0, "source": 0}],
        "samplers": [{"wrapS": 33071, "magFilter": 9728}],
        "images": [{"bufferView": len(arrays), "mimeType": "image/png"}],
        "skins": [{"joints": [0], "inverseBindMatrices": 7}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
        "extensionsUsed": ["EXT_mesh_gpu_instancing", *_PAINT["extensions"], *_OLD["extensions"]],
    }
    return header, binary
