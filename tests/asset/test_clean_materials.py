"""Materials that cannot weather stay clean, with a reason, and too small sheets grow first."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from squares import LEFT, RIGHT, altered, picture, two_squares, weathered

from svbrdfgan.asset import second_uv_set
from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document, write_document

BROKEN = {
    "broken": {},
    "missing file": {"uri": "nowhere.png"},
    "Basis Universal": {"uri": "basis.ktx2"},
}


@pytest.mark.parametrize("kind", [*BROKEN, "no source", "no texture"])
@pytest.mark.parametrize("key", ["baseColorTexture", "normalTexture"])
def test_a_material_with_a_picture_that_cannot_be_read_stays_clean(tmp_path: Path, kind: str, key: str) -> None:
    (tmp_path / "basis.ktx2").write_bytes(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(100))

    def change(document: Document) -> None:
        texture = document.add("textures", {} if kind == "no source" else {"source": 1})
        if kind in BROKEN:
            document.add("images", BROKEN[kind] or {"bufferView": document.add_view(b"no picture")})
        info = {"index": 7 if kind == "no texture" else texture}
        document.table("materials")[0] |= {"normalTexture": info} if key == "normalTexture" else {}
        if key == "baseColorTexture":
            document.table("materials")[0]["pbrMetallicRoughness"][key] = info

    clean = two_squares(tmp_path / "a.gltf", uv=(LEFT, RIGHT), materials=(0, 1))
    document = clean.document.copy()
    change(document)
    write_document(tmp_path / "b.glb", document)
    given = load_asset(tmp_path / "b.glb")
    edited = weathered(given, 0, 1, size=16)
    before, after = given.document.table("materials"), edited.document.table("materials")
    assert after[0] == before[0]
    assert "baseColorTexture" in after[1]["pbrMetallicRoughness"]
    assert len(edited.told) == 1
    assert edited.told[0].startswith("'paint' stays clean: ")


def test_a_broken_picture_of_another_format_leaves_the_plain_one(tmp_path: Path) -> None:
    def change(document: Document) -> None:
        broken = document.add("images", {"bufferView": document.add_view(b"nothing"), "mimeType": "image/ktx2"})
        document.table("textures")[0]["extensions"] = {"KHR_texture_basisu": {"source": broken}}

    edited = weathered(altered(two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0)), change), 0, 1)
    assert (picture(edited, 0)[:, :16] == (0, 0, 255)).all()


def many_squares(path: Path) -> Asset:
    """100 squares apart from each other, without UVs."""
    document = Document({"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}]}, [], path)
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], "<f4")
    shift = np.stack([*np.divmod(np.arange(100), 10), np.zeros(100)], axis=1)[:, None] * 2.0
    attributes = {"POSITION": append_accessor(document, (corners + shift).reshape(-1, 3).astype("<f4"), bounds=True)}
    faces = np.array([0, 1, 2, 0, 2, 3]) + 4 * np.arange(100)[:, None]
    primitive = {"attributes": attributes, "indices": append_accessor(document, faces.reshape(-1).astype("<u4"))}
    document.add(
        "nodes", {"name": "all", "mesh": document.add("meshes", {"primitives": [{**primitive, "material": 0}]})}
    )
    document.add("materials", {"name": "paint"})
    write_document(path, document)
    return load_asset(path)


def test_a_sheet_doubles_until_the_charts_fit(tmp_path: Path) -> None:
    pytest.importorskip("xatlas")
    edited = weathered(many_squares(tmp_path / "a.glb"), 0, size=16)
    size = picture(edited, 0).shape[0]
    assert size in (64, 128)
    assert f"'paint' gets textures of {size} texels a side: its charts do not fit 16." in edited.told


def test_charts_that_fit_no_sheet_leave_the_material_clean(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xatlas")
    monkeypatch.setattr(second_uv_set, "LARGEST_SIZE", 32)
    given = many_squares(tmp_path / "a.glb")
    edited = weathered(given, 0, size=16)
    assert edited.document.header == given.document.header
    assert len(edited.told) == 1
    assert edited.told[0].startswith("'paint' stays clean: 100 charts do not fit 32")
