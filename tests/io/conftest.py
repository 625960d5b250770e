"""Small mesh files that tests write by hand."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

Quad = Callable[..., Path]


@pytest.fixture
def gltf_quad() -> Quad:
    """Writes a unit square in the XY plane as .gltf, with a .bin beside it: `gltf_quad(folder, material, extra)`.

    `extra` joins the header. Seen from +Z, the texture is upright over TEXCOORD_0. Over TEXCOORD_1 it lies on its side:
    its u is 1 - y of the square, and its v is x.
    """

    def write(folder: Path, material: dict[str, Any], extra: dict[str, Any] | None = None) -> Path:
        positions = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")
        uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], dtype="<f4")
        sideways = np.array([[1, 1], [1, 0], [0, 0], [0, 1]], dtype="<f4")
        indices = np.array([0, 1, 2, 0, 2, 3], dtype="<u4")
        (folder / "quad data.bin").write_bytes(
            positions.tobytes() + uv.tobytes() + indices.tobytes() + sideways.tobytes()
        )
        attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 3}
        header = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": attributes, "indices": 2, "material": 0}]}],
            "materials": [material],
            "buffers": [{"uri": "quad%20data.bin", "byteLength": 136}],
            "bufferViews": [
                {"buffer": 0, "byteOffset": 0, "byteLength": 48},
                {"buffer": 0, "byteOffset": 48, "byteLength": 32},
                {"buffer": 0, "byteOffset": 80, "byteLength": 24},
                {"buffer": 0, "byteOffset": 104, "byteLength": 32},
            ],
            "accessors": [
                {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
                {"bufferView": 1, "componentType": 5126, "count": 4, "type": "VEC2"},
                {"bufferView": 2, "componentType": 5125, "count": 6, "type": "SCALAR"},
                {"bufferView": 3, "componentType": 5126, "count": 4, "type": "VEC2"},
            ],
            **(extra or {}),
        }
        path = folder / "quad.gltf"
        path.write_text(json.dumps(header))
        return path

    return write


@pytest.fixture
def quad(tmp_path: Path, gltf_quad: Quad) -> Quad:
    """Writes that square with pictures: `quad(material, picture=codes, ...)`, codes (rows, cols, 3 | 4).

    Textures are numbered in the order of the pictures.
    """

    def write(material: dict[str, Any], **pictures: np.ndarray) -> Path:
        for name, codes in pictures.items():
            Image.fromarray(codes.astype(np.uint8)).save(tmp_path / f"{name}.png")
        images = [{"uri": f"{name}.png"} for name in pictures]
        return gltf_quad(
            tmp_path, material, {"images": images, "textures": [{"source": index} for index in range(len(images))]}
        )

    return write
