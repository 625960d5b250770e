"""A document in which pieces weather: those have new textures, and all else is as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from squares import BLUE, LEFT, RED, RIGHT, UNIT, found, picture, two_squares, weathered

from svbrdfgan.asset.asset import load_asset
from svbrdfgan.io.gltf.document import write_document


def test_the_layer_lies_where_the_surface_is_in_the_asset_s_own_uvs(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    edited = weathered(asset, 0, 1)
    color = picture(edited, 0)
    assert color.shape == (32, 32, 3)
    assert (color[:, :16] == (0, 0, 255)).all()
    assert (color[:, 16:] == (255, 0, 0)).all()
    gloss = picture(edited, 0, "metallicRoughnessTexture")
    assert (gloss[:, :16, 1:] == (255, 128)).all()
    assert (gloss[:, 16:, 1:] == (64, 0)).all()
    assert found(edited, asset, tmp_path / "b.glb", "paint") == []
    assert edited.told == []


def test_where_the_layer_is_clear_no_byte_of_a_colour_changes(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    assert (picture(weathered(asset, 0, 1, alpha=0.0), 0) == (0, 0, 255)).all()


def test_textures_have_the_size_that_is_asked_for(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    assert picture(weathered(asset, 0, 1, size=64), 0).shape == (64, 64, 3)


def test_a_material_that_only_some_pieces_weather_is_copied(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    edited = weathered(asset, 1)
    first, second = (asset.source(piece).mesh for piece in (0, 1))
    meshes = edited.document.table("meshes")
    assert meshes[first]["primitives"][0]["material"] == 0
    assert meshes[second]["primitives"][0]["material"] == 2
    assert edited.document.table("materials")[0] == asset.document.table("materials")[0]
    assert "copied" in edited.told[0]
    assert found(edited, asset, tmp_path / "b.glb", "paint") == []


@pytest.mark.parametrize("uv", [(UNIT, UNIT), (None, None)], ids=["overlapping", "none"])
def test_a_second_uv_set_is_made_where_the_own_one_cannot_hold_a_layer(
    tmp_path: Path, uv: tuple[ndarray | None, ndarray | None]
) -> None:
    pytest.importorskip("xatlas")
    asset = two_squares(tmp_path / "a.glb", uv=uv, materials=(0, 0))
    edited = weathered(asset, 0, 1, size=64)
    number = 0 if uv[0] is None else 1
    assert (
        edited.document.table("materials")[0]["pbrMetallicRoughness"]["baseColorTexture"].get("texCoord", 0) == number
    )
    assert f"TEXCOORD_{number}" in edited.told[0]
    assert found(edited, asset, tmp_path / "b.glb", "paint") == []
    again = load_asset(tmp_path / "b.glb")
    color = picture(edited, 0).astype(int)
    for piece, wanted in ((0, BLUE), (1, RED)):
        places = again.uv(piece, number)
        assert places is not None
        middle = places.mean(axis=0) * 64
        shown = color[64 - 1 - int(middle[1]), int(middle[0])] / 255
        assert np.allclose(shown, wanted, atol=0.01)


def test_a_mesh_that_two_nodes_show_is_copied_for_places_that_differ(tmp_path: Path) -> None:
    pytest.importorskip("xatlas")
    asset = two_squares(tmp_path / "a.glb", uv=(UNIT, UNIT), materials=(0, 0))
    document = asset.document.copy()
    document.table("nodes")[1] |= {"mesh": 0, "translation": [1.0, 0.0, 0.0]}
    write_document(tmp_path / "shared.glb", document)
    shared = load_asset(tmp_path / "shared.glb")
    edited = weathered(shared, 0, 1, size=64)
    meshes = {node["mesh"] for node in edited.document.table("nodes")}
    assert len(meshes) == 2
    assert found(edited, shared, tmp_path / "b.glb", "paint") == []


def test_a_variant_of_what_is_kept_keeps_its_material(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(1, 0))
    document = asset.document.copy()
    for mesh in document.table("meshes"):
        mappings = [{"material": 0, "variants": [0]}]
        mesh["primitives"][0]["extensions"] = {"KHR_materials_variants": {"mappings": mappings}}
    document.header |= {"extensionsUsed": ["KHR_materials_variants"]}
    document.header["extensions"] = {"KHR_materials_variants": {"variants": [{"name": "painted"}]}}
    write_document(tmp_path / "variants.glb", document)
    shown = load_asset(tmp_path / "variants.glb")
    edited = weathered(shown, 1).document
    kept, changed = (mesh["primitives"][0] for mesh in edited.table("meshes"))
    assert kept["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] == 0
    assert edited.table("materials")[0] == shown.document.table("materials")[0]
    assert changed["material"] == 2
    assert changed["extensions"]["KHR_materials_variants"]["mappings"][0]["material"] == 2


def test_what_lies_outside_of_the_scene_keeps_its_material(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    document = asset.document.copy()
    document.table("scenes")[0]["nodes"] = [1]
    write_document(tmp_path / "part.glb", document)
    edited = weathered(load_asset(tmp_path / "part.glb"), 0).document
    assert edited.table("materials")[0] == document.table("materials")[0]
    assert [mesh["primitives"][0]["material"] for mesh in edited.table("meshes")] == [0, 2]


def test_a_replaced_picture_leaves_the_file(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    whole, copied = weathered(asset, 0, 1).document, weathered(asset, 1).document
    assert (len(whole.table("textures")), len(whole.table("images"))) == (2, 2)
    assert len(whole.views) == len(asset.document.views) + 1
    assert (len(copied.table("textures")), len(copied.table("images"))) == (3, 3)
    assert picture(weathered(asset, 1), 0).tobytes() == bytes((0, 0, 255)) * 32 * 32


def test_of_nothing_that_weathers_the_document_stays(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 1))
    edited = weathered(asset)
    assert edited.document.header == asset.document.header
    assert found(edited, asset, tmp_path / "b.glb") == []
