"""A layer beside a file: over one further UV set of all that weathers, and nothing else of the file differs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from documents import differences
from gltf_reader import read
from permissions import Allowed, Change
from squares import BLUE, RED, UNIT, Halves, two_squares

from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.islands import signed_areas
from svbrdfgan.asset.overlay import Overlay, overlay_document
from svbrdfgan.asset.packing import ChartsError
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.painters import Paint
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.shared_texels import texel_use
from svbrdfgan.asset.weather_document import Textures
from svbrdfgan.io.gltf.document import write_document

pytest.importorskip("xatlas")


class Everywhere(Halves):
    """Blue at half alpha where x < 0, and solid red elsewhere."""

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        paint = super().__call__(points, texel)
        left = paint.alpha == 0.0
        return replace(paint, color=np.where(left[:, None], BLUE, RED), alpha=np.where(left, 0.5, paint.alpha))


def overlaid(asset: Asset, *pieces: int, size: int = 64) -> Overlay:
    model = Model(asset.mesh, np.zeros(len(asset.mesh.faces), bool))
    return overlay_document(asset, model, Everywhere(asset.mesh), pieces, Textures(size=size, painted=512))


def squares(path: Path) -> Asset:
    """Two squares of two materials, one over another in UV, the second without UVs."""
    return two_squares(path, uv=(UNIT, None), materials=(0, 1))


def test_all_that_weathers_has_one_atlas_without_overlaps(tmp_path: Path) -> None:
    overlay = overlaid(squares(tmp_path / "a.glb"), 0, 1)
    write_document(tmp_path / "b.glb", overlay.edited.document)
    again = load_asset(tmp_path / "b.glb")
    uv = np.zeros((len(again.mesh.faces), 3, 2))
    for piece in (0, 1):
        places = again.uv(piece, 1)
        assert places is not None
        mine = again.face_piece == piece
        uv[mine] = places[again.corner_vertices[mine]]
    assert uv.min() >= 0.0
    assert uv.max() <= 1.0
    assert np.abs(signed_areas(uv)).sum() > 0.35
    assert not texel_use(again.mesh.positions[again.mesh.faces], uv, 64, 64).doubled.any()


def test_the_layer_is_straight_and_lies_over_the_new_uvs(tmp_path: Path) -> None:
    overlay = overlaid(squares(tmp_path / "a.glb"), 0, 1)
    write_document(tmp_path / "b.glb", overlay.edited.document)
    again = load_asset(tmp_path / "b.glb")
    for piece, wanted in ((0, (*BLUE, 0.5)), (1, (*RED, 1.0))):
        places = again.uv(piece, 1)
        assert places is not None
        col, row = (places.mean(axis=0) * 64).astype(int)
        np.testing.assert_allclose(overlay.maps["base_color"][row, col] / 255, wanted, atol=0.01)
        np.testing.assert_allclose(overlay.maps["orm"][row, col] / 255, (1.0, 0.25, 0.0), atol=0.01)
        np.testing.assert_allclose(overlay.maps["normal"][row, col] / 255, (0.5, 0.5, 1.0), atol=0.01)


def test_materials_and_all_else_of_the_file_stay(tmp_path: Path) -> None:
    asset = squares(tmp_path / "a.glb")
    overlay = overlaid(asset, 0)
    after = overlay.edited.document
    for name in ("materials", "textures", "images", "nodes", "scenes"):
        assert after.table(name) == asset.document.table(name)
    first, second = (after.table("meshes")[number]["primitives"][0]["attributes"] for number in (0, 1))
    assert set(first) == {"POSITION", "TEXCOORD_0", "TEXCOORD_1"}
    assert second == asset.document.table("meshes")[1]["primitives"][0]["attributes"]
    write_document(tmp_path / "b.glb", after)
    allowed = Allowed(frozenset({"paint"}), Change.UV_SETS)
    assert differences(read(asset.path), read(tmp_path / "b.glb"), allowed) == []
    assert overlay.edited.told == ["the layer lies over TEXCOORD_1 of all that weathers, at 64 texels a side."]


def test_maps_that_are_not_painted_are_left_out(tmp_path: Path) -> None:
    asset = squares(tmp_path / "a.glb")

    class Color(Everywhere):
        maps = ()

    model = Model(asset.mesh, np.zeros(len(asset.mesh.faces), bool))
    overlay = overlay_document(asset, model, Color(asset.mesh), (0, 1), Textures(size=64))
    assert list(overlay.maps) == ["base_color"]


def test_charts_that_do_not_fit_get_a_larger_layer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asset = squares(tmp_path / "a.glb")
    assert overlaid(asset, 0, 1, size=4).maps["base_color"].shape[0] > 4
    monkeypatch.setattr("svbrdfgan.asset.second_uv_set.LARGEST_SIZE", 4)
    with pytest.raises(ChartsError, match="charts do not fit"):
        overlaid(asset, 0, 1, size=4)
