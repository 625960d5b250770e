"""What each kind of material becomes under a layer: the table of `docs/conventions.md`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy import ndarray
from squares import LEFT, RIGHT, UNIT, add_picture, altered, found, picture, shown, two_squares, weathered

from svbrdfgan.asset.asset import Asset
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document, write_document
from svbrdfgan.io.image import linear_from_srgb, srgb_from_linear
from svbrdfgan.io.mesh import load_mesh

RAMP = np.stack([np.full((8, 8), 40), np.full((8, 8), 90), np.full((8, 8), 140), np.arange(64).reshape(8, 8) * 4], -1)


def encoded(linear: Any) -> ndarray:
    """Bytes of sRGB."""
    return (srgb_from_linear(torch.as_tensor(linear).double()) * 255).round().numpy()


def decoded(stored: Any) -> ndarray:
    return linear_from_srgb(torch.as_tensor(stored).double() / 255).numpy()


def asset(path: Path, material: dict[str, Any] | None = None, *pictures: ndarray, **texture: Any) -> Asset:
    """Two squares side by side in UV, both of the first material: this one, whose pictures have numbers from 1."""

    def change(document: Document) -> None:
        for pixels in pictures:
            add_picture(document, pixels, **texture)
        if material is not None:
            document.table("materials")[0] = {"name": "paint", **material}

    return altered(two_squares(path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 0)), change)


def new_map(given: Asset, *keys: str, alpha: float = 1.0, size: int | None = None) -> ndarray:
    """The new picture at this place of the first material, after all weathered."""
    edited = weathered(given, 0, 1, alpha=alpha, size=size)
    info = edited.document.table("materials")[0]
    for key in keys:
        info = info[key]
    return shown(edited.document, info).astype(int)


def color_vertices(given: Asset, *colors: ndarray) -> Asset:
    """The asset with these colours of vertices, of one mesh after the other."""

    def change(document: Document) -> None:
        for mesh, stored in zip(document.table("meshes"), colors, strict=False):
            keys = {"normalized": True} if stored.dtype != np.dtype("f4") else {}
            mesh["primitives"][0]["attributes"]["COLOR_0"] = append_accessor(document, stored, **keys)

    return altered(given, change)


def has_colors(document: Document) -> list[bool]:
    meshes = (document.table("meshes")[node["mesh"]] for node in document.table("nodes"))
    return ["COLOR_0" in mesh["primitives"][0]["attributes"] for mesh in meshes]


def test_vertex_colors_move_into_the_texture_below_the_layer(tmp_path: Path) -> None:
    half = np.tile(np.array([255, 255, 51, 0], "u1"), (4, 1))
    given = color_vertices(asset(tmp_path), half, half)
    edited = weathered(given, 0, 1)
    color = picture(edited, 0)
    assert color.shape[2] == 3
    assert (color[:, :16] == (0, 0, encoded(0.2))).all()
    assert (color[:, 16:] == (255, 0, 0)).all()
    assert has_colors(edited.document) == [False, False]
    assert [sentence for sentence in edited.told if "vertex colours" in sentence] == edited.told
    assert found(edited, given, tmp_path / "b.glb", "paint") == []


def test_a_vertex_color_that_is_no_number_tints_nothing(tmp_path: Path) -> None:
    colors = np.full((4, 4), 0.5, "<f4")
    colors[0] = np.nan
    blue = picture(weathered(color_vertices(asset(tmp_path), colors), 0, 1), 0)[:, :16, 2]
    assert encoded(0.5) <= blue.min() < encoded(0.52)
    assert blue.max() > encoded(0.95)
    given = color_vertices(asset(tmp_path, {}), colors, np.full((4, 4), 0.25, "<f4"))
    for mesh in given.document.table("meshes"):
        del mesh["primitives"][0]["material"]
    write_document(tmp_path / "plain.glb", given.document)
    assert load_mesh(tmp_path / "plain.glb").parts[0].base_color == (0.625, 0.625, 0.625)


def test_vertex_colors_are_interpolated_in_linear_space(tmp_path: Path) -> None:
    left_to_right = np.array([[0, 0, 0], [1, 1, 1], [1, 1, 1], [0, 0, 0]], "<f4")
    color = picture(weathered(color_vertices(asset(tmp_path), left_to_right), 0, 1), 0).astype(int)
    assert np.abs(color[:, :16, 2] - encoded((np.arange(16) + 0.5) / 16)).max() <= 1


def test_white_vertex_colors_stay(tmp_path: Path) -> None:
    given = color_vertices(asset(tmp_path), np.full((4, 3), 255, "u1"), np.ones((4, 4), "<f4"))
    edited = weathered(given, 0, 1)
    assert has_colors(edited.document) == [True, True]
    assert edited.told == []


def test_vertex_colors_stay_where_pieces_stay(tmp_path: Path) -> None:
    half = np.full((4, 3), 0.5, "<f4")
    edited = weathered(color_vertices(asset(tmp_path), half, half), 1)
    assert has_colors(edited.document) == [True, False]


def test_vertex_alpha_of_translucent_materials_moves_too(tmp_path: Path) -> None:
    half = np.tile(np.array([1.0, 1.0, 1.0, 0.4], "<f4"), (4, 1))
    given = color_vertices(asset(tmp_path, {"alphaMode": "BLEND"}), half, half)
    color = new_map(given, "pbrMetallicRoughness", "baseColorTexture")
    middle, border = color.shape[1] // 2, color.shape[1] // 20
    assert (color[:, : middle - border, 3] == 102).all()
    assert (color[:, middle + border :] == (255, 0, 0, 255)).all()


SPECULAR_GLOSS = {
    "diffuseTexture": {"index": 1},
    "specularGlossinessTexture": {"index": 1},
    "specularFactor": [0.5, 1.0, 1.0],
    "glossinessFactor": 0.5,
}


@pytest.mark.parametrize("fallback", [{}, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}])
def test_specular_glossiness_and_its_fallback(tmp_path: Path, fallback: dict[str, Any]) -> None:
    extension = {"KHR_materials_pbrSpecularGlossiness": SPECULAR_GLOSS}
    edited = weathered(asset(tmp_path, {"extensions": extension, **fallback}, RAMP), 0, 1)
    material = edited.document.table("materials")[0]
    entry = material["extensions"]["KHR_materials_pbrSpecularGlossiness"]
    assert set(entry) == {"diffuseTexture", "specularGlossinessTexture"}
    diffuse, gloss = (shown(edited.document, entry[key]).astype(int) for key in entry)
    assert (diffuse[:, :4] == RAMP[:, :4]).all()
    assert (diffuse[:, 4:, :3] == (255, 0, 0)).all()
    assert (gloss[:, :4, :3] == encoded(decoded([40, 90, 140]) * (0.5, 1.0, 1.0))).all()
    assert np.abs(gloss[:, :4, 3] - RAMP[:, :4, 3] / 2).max() <= 0.5
    assert (gloss[:, 4:] == (*[encoded(0.04)] * 3, 191)).all()
    assert ("pbrMetallicRoughness" in material) == bool(fallback)
    if fallback:
        assert (shown(edited.document, material["pbrMetallicRoughness"]["baseColorTexture"]) == diffuse).all()


def test_masks_keep_their_bytes_and_cutoff(tmp_path: Path) -> None:
    material = {"alphaMode": "MASK", "alphaCutoff": 0.3, "pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}
    given = asset(tmp_path, material, RAMP)
    assert (new_map(given, "pbrMetallicRoughness", "baseColorTexture")[..., 3] == RAMP[..., 3]).all()
    assert weathered(given, 0, 1).document.table("materials")[0]["alphaCutoff"] == 0.3


def test_a_resized_mask_covers_as_much_and_colors_stay_under_alpha_0(tmp_path: Path) -> None:
    pixels = np.full((8, 8, 4), 200)
    pixels[:, :3, 3] = 0
    material = {"alphaMode": "MASK", "pbrMetallicRoughness": {"baseColorTexture": {"index": 1}}}
    color = new_map(asset(tmp_path, material, pixels), "pbrMetallicRoughness", "baseColorTexture", size=64)
    assert abs((color[..., 3] >= 128).mean() - 5 / 8) < 0.02
    assert (color[:, :32, :3] == 200).all()


def test_a_layer_covers_translucent_materials(tmp_path: Path) -> None:
    pbr = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1.0, 1.0, 1.0, 0.4]}
    given = asset(tmp_path, {"alphaMode": "BLEND", "pbrMetallicRoughness": pbr})
    color = new_map(given, "pbrMetallicRoughness", "baseColorTexture", alpha=0.25)
    assert (color[:, :16] == (0, 0, 255, 102)).all()
    share = 0.25 / 0.55
    assert (color[:, 16:] == (encoded(share), 0, encoded(1 - share), 140)).all()
    assert "baseColorFactor" not in weathered(given, 0, 1).document.table("materials")[0]["pbrMetallicRoughness"]


def test_light_fades_linearly(tmp_path: Path) -> None:
    extensions = {
        "KHR_materials_emissive_strength": {"emissiveStrength": 3.0},
        "KHR_materials_sheen": {"sheenColorFactor": [0.5, 0.5, 0.5], "sheenColorTexture": {"index": 1}},
    }
    material = {"emissiveFactor": [0.2, 1, 1], "emissiveTexture": {"index": 1}, "extensions": extensions}
    given = asset(tmp_path, material, RAMP)
    for keys in (("emissiveTexture",), ("extensions", "KHR_materials_sheen", "sheenColorTexture")):
        faded = new_map(given, *keys, alpha=0.75)
        assert (faded[:, :4] == RAMP[:, :4]).all()
        assert (faded[:, 4:, :3] == encoded(0.25 * decoded(RAMP[:, 4:, :3]))).all()
        assert (faded[..., 3] == RAMP[..., 3]).all()
    after = weathered(given, 0, 1).document.table("materials")[0]
    assert (after["emissiveFactor"], after["extensions"]["KHR_materials_emissive_strength"]) == (
        [0.2, 1, 1],
        {"emissiveStrength": 3.0},
    )


@pytest.mark.parametrize(
    ("name", "prefix", "channel"),
    [
        ("clearcoat", "clearcoat", 0),
        ("transmission", "transmission", 0),
        ("iridescence", "iridescence", 0),
        ("diffuse_transmission", "diffuseTransmission", 3),
    ],
)
def test_what_dirt_covers_fades_in_its_own_channel(tmp_path: Path, name: str, prefix: str, channel: int) -> None:
    entry = {f"{prefix}Factor": 0.5, f"{prefix}Texture": {"index": 1}, f"{prefix}RoughnessTexture": {"index": 1}}
    given = asset(tmp_path, {"extensions": {f"KHR_materials_{name}": entry}}, RAMP)
    faded = new_map(given, "extensions", f"KHR_materials_{name}", f"{prefix}Texture", alpha=0.5)
    wanted = RAMP.astype(float)
    wanted[:, 4:, channel] /= 2
    assert (faded == wanted).all()
    kept = new_map(given, "extensions", f"KHR_materials_{name}", f"{prefix}RoughnessTexture", alpha=0.5)
    assert (kept == RAMP).all()


def test_specular_goes_to_one_in_alpha_and_its_color_stays(tmp_path: Path) -> None:
    entry = {"specularFactor": 0.5, "specularTexture": {"index": 1}, "specularColorTexture": {"index": 1}}
    given = asset(tmp_path, {"extensions": {"KHR_materials_specular": entry}}, RAMP)
    changed = new_map(given, "extensions", "KHR_materials_specular", "specularTexture")
    assert (changed[..., :3] == RAMP[..., :3]).all()
    assert np.abs(changed[:, :4, 3] - RAMP[:, :4, 3] / 2).max() <= 0.5
    assert (changed[:, 4:, 3] == 255).all()
    assert (new_map(given, "extensions", "KHR_materials_specular", "specularColorTexture") == RAMP).all()
    after = weathered(given, 0, 1).document.table("materials")[0]["extensions"]["KHR_materials_specular"]
    assert "specularFactor" not in after


def test_of_unlit_materials_the_color_alone_changes(tmp_path: Path) -> None:
    extensions = {"KHR_materials_unlit": {}, "KHR_materials_anisotropy": {"anisotropyStrength": 0.5}}
    more = {"emissiveFactor": [1, 1, 1], "normalTexture": {"index": 0}, "extensions": extensions}
    given = asset(tmp_path, {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, **more})
    after = weathered(given, 0, 1).document
    assert len(after.table("textures")) == 2
    assert {key: after.table("materials")[0][key] for key in more} == more


def test_small_numbers_of_vertices_are_aligned(tmp_path: Path) -> None:
    """Each vertex of an array starts at a multiple of four bytes, after a second UV set has split vertices, too."""
    pytest.importorskip("xatlas")
    overlapping = two_squares(tmp_path / "a.glb", uv=(UNIT, UNIT), materials=(0, 0))
    given = color_vertices(overlapping, np.full((4, 3), 255, "u1"), np.full((4, 3), 9, "u1"))
    edited = weathered(given, 0, size=64)
    for mesh in edited.document.table("meshes"):
        accessor = edited.document.table("accessors")[mesh["primitives"][0]["attributes"]["COLOR_0"]]
        assert edited.document.table("bufferViews")[accessor["bufferView"]]["byteStride"] == 4
    assert found(edited, given, tmp_path / "b.glb", "paint") == []
