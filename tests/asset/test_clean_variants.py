"""Clean and weathered as variants of one document."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from squares import LEFT, RIGHT, Halves, altered, shown, two_squares

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.weather_document import Edited, Textures, weather_document
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document


def weathered(asset: Asset, *pieces: int) -> Edited:
    model = Model(asset.mesh, np.zeros(len(asset.mesh.faces), bool))
    textures = Textures(size=32, painted=512)
    return weather_document(asset, model, Halves(asset.mesh), pieces, textures, variants=True)


def state(document: Document, node: int, variant: int) -> tuple[dict[str, Any], bool]:
    """The material that a primitive has in a variant, and whether viewers without variants show it."""
    primitive = document.table("meshes")[document.table("nodes")[node]["mesh"]]["primitives"][0]
    mappings = primitive["extensions"]["KHR_materials_variants"]["mappings"]
    (number,) = [mapping["material"] for mapping in mappings if mapping["variants"] == [variant]]
    return document.table("materials")[number], number == primitive["material"]


@pytest.mark.parametrize("pieces", [(0, 1), (1,)], ids=["in place", "copied"])
def test_the_clean_material_is_a_variant_of_the_weathered_one(tmp_path: Path, pieces: tuple[int, ...]) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    document = weathered(asset, *pieces).document
    assert document.header["extensions"]["KHR_materials_variants"] == {
        "variants": [{"name": "clean"}, {"name": "weathered"}]
    }
    assert document.header["extensionsUsed"] == ["KHR_materials_variants"]
    clean, dirty = state(document, 1, 0), state(document, 1, 1)
    assert clean == (asset.document.table("materials")[0], False)
    assert dirty[1]
    colors = [shown(document, look["pbrMetallicRoughness"]["baseColorTexture"])[:, 16:] for look, _ in (clean, dirty)]
    assert (colors[0] == (0, 0, 255)).all()
    assert (colors[1] == (255, 0, 0)).all()


def test_a_file_with_variants_keeps_its_own(tmp_path: Path) -> None:
    own = {"variants": [{"name": "red"}]}
    asset = two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0))
    asset = altered(asset, lambda document: document.header.update(extensions={"KHR_materials_variants": own}))
    edited = weathered(asset, 0, 1)
    assert edited.document.header["extensions"]["KHR_materials_variants"] == own
    assert "has variants already" in edited.told[-1]


def test_vertex_colours_in_a_texture_leave_no_clean_variant(tmp_path: Path) -> None:
    def tint(document: Document) -> None:
        grey = np.full((4, 3), 0.5, "<f4")
        for mesh in document.table("meshes"):
            mesh["primitives"][0]["attributes"]["COLOR_0"] = append_accessor(document, grey)

    edited = weathered(altered(two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0)), tint), 0, 1)
    assert "'paint' has no clean variant" in edited.told[-1]
    assert "extensions" not in edited.document.table("meshes")[0]["primitives"][0]
