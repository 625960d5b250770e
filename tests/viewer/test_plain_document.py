"""What browsers do not read is rewritten."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image

from svbrdfgan.io.gltf.document import Document, picture_bytes, picture_type
from svbrdfgan.io.gltf_codecs.pictures import KTX2
from svbrdfgan.viewer.plain_document import make_plain


def ktx2(pixels: bytes, width: int, height: int) -> bytes:
    """Plain RGBA pixels (Vulkan's format 43) as KTX2."""
    head = struct.pack("<9I", 43, 1, width, height, 0, 0, 1, 1, 0) + bytes(32)
    return KTX2 + head + struct.pack("<3Q", 104, len(pixels), len(pixels)) + pixels


def test_pictures_of_ktx2_become_png() -> None:
    broken, whole = KTX2 + bytes(200), ktx2(bytes([255, 0, 0, 255] * 4), 2, 2)
    header = {
        "images": [{"bufferView": k, "mimeType": "image/ktx2"} for k in range(2)],
        "bufferViews": [{"buffer": 0, "byteLength": len(data)} for data in (broken, whole)],
        "textures": [{"extensions": {"KHR_texture_basisu": {"source": k}}} for k in range(2)],
        "extensionsUsed": ["KHR_texture_basisu"],
        "extensionsRequired": ["KHR_texture_basisu"],
    }
    document = Document(header, [broken, whole], Path("a.glb"))
    make_plain(document)
    assert [picture_type(picture_bytes(document, k)) for k in range(2)] == ["image/png"] * 2
    assert [texture["source"] for texture in document.table("textures")] == [0, 1]
    assert "extensionsUsed" not in header
    assert "extensionsRequired" not in header


def test_specular_and_glossiness_become_a_dielectric() -> None:
    stored = {
        "diffuseFactor": [0.5, 0.4, 0.3, 0.9],
        "diffuseTexture": {"index": 0},
        "glossinessFactor": 0.75,
        "specularFactor": [0.02, 0.04, 1.0],
        "specularGlossinessTexture": {"index": 1},
    }
    name = "KHR_materials_pbrSpecularGlossiness"
    header = {"materials": [{"extensions": {name: stored}}, {"name": "other"}], "extensionsUsed": [name]}
    make_plain(Document(header, [], Path("a.glb")))
    made, other = header["materials"]
    assert made["pbrMetallicRoughness"] == {
        "baseColorFactor": [0.5, 0.4, 0.3, 0.9],
        "baseColorTexture": {"index": 0},
        "metallicFactor": 0.0,
        "roughnessFactor": 0.25,
    }
    assert made["extensions"] == {}
    assert other == {"name": "other"}
    assert "extensionsUsed" not in header


@pytest.mark.parametrize(
    "uri", ["https://example.com/track.png", "//example.com/a.png", "missing.png", "/etc/passwd", "data:,a", None]
)
def test_pictures_that_may_not_be_read_are_not_asked_for(tmp_path: Path, uri: str | None) -> None:
    header = {"images": [{"uri": uri}], "textures": [{"source": 0}]}
    document = Document(header, [], tmp_path / "a.gltf")
    make_plain(document)
    (entry,) = document.table("images")
    assert "uri" not in entry
    assert Image.open(BytesIO(picture_bytes(document, 0))).getpixel((0, 0)) == (255, 255, 255)
