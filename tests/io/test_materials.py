"""What files say of materials beside base colour."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from svbrdfgan.errors import AssetError
from svbrdfgan.io import load_mesh, save_mesh_glb
from svbrdfgan.types import FileMap, Mesh, Part

Quad = Callable[..., Path]
CODES = np.random.default_rng(7).integers(0, 256, (4, 6, 4))
"""RGBA; row 0 is the top of the picture."""


def only_part(path: Path) -> Part:
    (part,) = load_mesh(path).parts
    return part


def factors(part: Part) -> dict[str, tuple[float, ...]]:
    assert all(given.texture is None for given in part.file_maps.values())
    return {name: given.factor for name, given in part.file_maps.items()}


def pbr(**keys: Any) -> dict[str, Any]:
    return {"name": "m", "pbrMetallicRoughness": keys}


@pytest.mark.parametrize(
    ("material", "rough", "metallic"),
    [
        ({"name": "m"}, 1.0, 1.0),  # glTF's defaults
        (pbr(baseColorFactor=[1, 0, 0, 1]), 1.0, 1.0),
        (pbr(roughnessFactor=0.123456789), 0.123456789, 1.0),
        (pbr(metallicFactor=0.0), 1.0, 0.0),
        (pbr(metallicFactor=0.0, roughnessFactor=7.0), 1.0, 0.0),
        ({**pbr(roughnessFactor=0.5), "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}}}, 0.5, 1.0),
    ],
)
def test_gltf_s_factors_are_read(quad: Quad, material: dict[str, Any], rough: float, metallic: float) -> None:
    assert factors(only_part(quad(material))) == {"roughness": (rough,), "metallic": (metallic,)}


def test_roughness_is_green_and_metallic_blue_and_neither_is_srgb(quad: Quad) -> None:
    material = pbr(metallicRoughnessTexture={"index": 0}, roughnessFactor=0.5, metallicFactor=0.25)
    maps = only_part(quad(material, gloss=CODES[..., :3])).file_maps
    assert (maps["roughness"].factor, maps["metallic"].factor) == ((0.5,), (0.25,))
    for name, channel in (("roughness", 1), ("metallic", 2)):
        texture = maps[name].texture
        assert texture is not None
        np.testing.assert_allclose(texture, CODES[::-1, :, channel : channel + 1] / 255, atol=1e-6)


def test_a_channel_that_is_one_everywhere_is_no_texture(quad: Quad) -> None:
    codes = np.stack([CODES[..., 0], CODES[..., 1], np.full_like(CODES[..., 2], 255)], axis=-1)
    maps = only_part(quad(pbr(metallicRoughnessTexture={"index": 0}, metallicFactor=0.5), gloss=codes)).file_maps
    assert maps["metallic"] == FileMap((0.5,))
    assert maps["roughness"].texture is not None


@pytest.mark.parametrize("scale", [None, 0.5])
def test_a_normal_texture_is_read_with_its_scale(quad: Quad, scale: float | None) -> None:
    texture = {"index": 1} if scale is None else {"index": 1, "scale": scale}
    material = {**pbr(baseColorTexture={"index": 0}), "normalTexture": texture}
    part = only_part(quad(material, color=CODES[..., :3], normal=CODES[..., 1:]))
    given = part.file_maps["normal"]
    assert given.factor == (scale or 1.0, scale or 1.0, 1.0)
    assert given.texture is not None
    np.testing.assert_allclose(0.5 + 0.5 * given.texture, CODES[::-1, :, 1:] / 255, atol=1e-6)


@pytest.mark.parametrize(
    ("keys", "factor", "expected"),
    [
        ({}, 0.3, None),
        ({"alphaMode": "OPAQUE"}, 0.3, None),
        ({"alphaMode": "BLEND"}, 1.0, None),
        ({"alphaMode": "BLEND"}, 0.3, FileMap((0.3,))),
        ({"alphaMode": "MASK"}, 0.5, None),
        ({"alphaMode": "MASK"}, 0.3, FileMap((0.3,), cutoff=0.5)),
        ({"alphaMode": "MASK", "alphaCutoff": 0.2}, 0.3, None),
    ],
)
def test_alpha_counts_by_its_mode(quad: Quad, keys: dict[str, Any], factor: float, expected: FileMap | None) -> None:
    part = only_part(quad({**pbr(baseColorFactor=[1, 1, 1, factor]), **keys}))
    assert part.file_maps.get("alpha") == expected
    assert part.opaque  # of a mesh's part; surfaces have alpha over their own UV


@pytest.mark.parametrize("mode", ["OPAQUE", "MASK", "BLEND"])
def test_alpha_of_a_texture_is_read_where_it_counts(quad: Quad, mode: str) -> None:
    material = {**pbr(baseColorTexture={"index": 0}, baseColorFactor=[1, 1, 1, 0.75]), "alphaMode": mode}
    alpha = only_part(quad(material, color=CODES)).file_maps.get("alpha")
    if mode == "OPAQUE":
        assert alpha is None
        return
    assert alpha is not None
    assert alpha.texture is not None
    assert (alpha.factor, alpha.cutoff) == ((0.75,), 0.5 if mode == "MASK" else None)
    np.testing.assert_allclose(alpha.texture, CODES[::-1, :, 3:] / 255, atol=1e-6)


def test_a_picture_that_cannot_be_read_leaves_its_factors(quad: Quad, caplog: pytest.LogCaptureFixture) -> None:
    material = {**pbr(metallicRoughnessTexture={"index": 0}, roughnessFactor=0.5), "normalTexture": {"index": 0}}
    path = quad(material, gloss=CODES)
    (path.parent / "gloss.png").write_bytes(b"not a picture")
    assert factors(only_part(path)) == {"roughness": (0.5,), "metallic": (1.0,)}
    assert "metallicRoughnessTexture" in caplog.text
    assert "normalTexture" in caplog.text


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        ("Ks 1 1 1\nNs 250\nillum 2", {}),  # Phong's, which most exporters write by default
        ("d 0.25", {"alpha": (0.25,)}),
        ("d -halo 0.25", {"alpha": (0.25,)}),
        ("Tr 0.25", {"alpha": (0.75,)}),
        ("d 1\nTr 0.25", {}),
        ("d what", {}),
        ("Pr 0.3", {"roughness": (0.3,), "metallic": (0.0,)}),
        ("Pm 1\nPr 0.3\nd 0.5", {"alpha": (0.5,), "roughness": (0.3,), "metallic": (1.0,)}),
    ],
)
def test_mtl_has_alpha_and_gloss_where_it_says_so(
    tmp_path: Path, lines: str, expected: dict[str, tuple[float, ...]]
) -> None:
    (tmp_path / "a.mtl").write_text(f"newmtl m\nKd 0.1 0.2 0.3\n{lines}\n")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n")
    assert factors(only_part(tmp_path / "a.obj")) == expected


@pytest.mark.parametrize("suffix", [".ply", ".stl", ".glb"])
def test_without_a_material_there_is_no_gloss(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box()
    box.export(tmp_path / f"box{suffix}")
    assert only_part(tmp_path / f"box{suffix}").file_maps == {}


def test_a_mesh_comes_back_with_its_materials(tmp_path: Path) -> None:
    """Also parts without gloss, which glTF does not know."""
    rgba = np.random.default_rng(1).integers(0, 255, (4, 5, 7)).astype(np.float32) / 255
    maps = {
        "roughness": FileMap((0.5,), rgba[..., 4:5]),
        "metallic": FileMap((0.25,), rgba[..., 5:6]),
        "normal": FileMap((0.75, 0.75, 1.0), 2 * rgba[..., 4:] - 1),
        "alpha": FileMap((0.875,), rgba[..., 3:4], cutoff=0.125),
    }
    parts = (
        Part("chrome", (0.9, 0.9, 0.9), file_maps={"roughness": FileMap((0.1,)), "metallic": FileMap((1.0,))}),
        Part("glass", (0.1, 0.2, 0.3), file_maps={"alpha": FileMap((0.3,))}),
        Part("paint", (0.5, 1.0, 1.0), rgba[..., :3], file_maps=maps),
        Part("chalk", (0.5, 1.0, 1.0)),
        Part("net", (0.5, 1.0, 1.0), file_maps={"alpha": maps["alpha"]}),
    )
    positions = np.random.default_rng(2).random((15, 3)).astype(np.float32).astype(float)
    faces = np.arange(15).reshape(5, 3)
    save_mesh_glb(tmp_path / "a.glb", Mesh(positions, faces, np.arange(5), parts, positions[faces][..., :2]))
    again = load_mesh(tmp_path / "a.glb").parts
    for part, read in zip(parts, again, strict=True):
        assert part.file_maps.keys() == read.file_maps.keys(), part.name
        for name, given in part.file_maps.items():
            found = read.file_maps[name]
            assert (given.factor, given.cutoff) == (found.factor, found.cutoff)
            assert (given.texture is None) == (found.texture is None)
            if given.texture is not None and found.texture is not None:
                np.testing.assert_allclose(found.texture, given.texture, atol=1e-6, err_msg=name)
    # nothing is lost by writing it once more
    save_mesh_glb(tmp_path / "b.glb", load_mesh(tmp_path / "a.glb"))
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


def test_textures_of_one_picture_that_differ_in_size_are_refused(tmp_path: Path) -> None:
    maps = {"alpha": FileMap((1.0,), np.zeros((2, 2, 1), np.float32))}
    part = Part("a", (1.0, 1.0, 1.0), np.zeros((3, 3, 3), np.float32), file_maps=maps)
    triangle = np.eye(3)
    mesh = Mesh(triangle, np.array([[0, 1, 2]]), np.array([0]), (part,), triangle[None, :, :2])
    with pytest.raises(AssetError, match=r"sizes \[\(2, 2\), \(3, 3\)\]; wanted one size"):
        save_mesh_glb(tmp_path / "a.glb", mesh)


UNKNOWN = ({"gloss": FileMap((1.0,))}, {"alpha": FileMap((1.0, 0.0))}, {"alpha": FileMap((1.0,), np.zeros((2, 2, 3)))})


@pytest.mark.parametrize("maps", UNKNOWN)
def test_maps_that_files_do_not_have_are_refused(maps: dict[str, FileMap]) -> None:
    with pytest.raises(AssetError, match="part 'a' has a map"):
        Part("a", file_maps=maps)


def test_real_vehicles_are_dielectric_and_opaque(assets: Path) -> None:
    for name in ("cesium_milk_truck", "quaternius_real_suv", "kenney_sedan"):
        for part in load_mesh(assets / "cars" / f"{name}.glb").parts:
            assert factors(part) == {"roughness": (0.6,), "metallic": (0.0,)}
