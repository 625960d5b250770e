"""What files say of materials beside base colour."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.mesh import load_mesh
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


def corner_uv(mesh: Mesh, given: FileMap) -> np.ndarray:
    """Where the map's texture is looked up at the square's corners, counter-clockwise from the origin."""
    uv = mesh.uv_set(given.uv_set)
    assert uv is not None
    at = {
        tuple(mesh.positions[vertex][:2]): uv[f, k]
        for f, face in enumerate(mesh.faces)
        for k, vertex in enumerate(face)
    }
    return np.array([at[corner] for corner in ((0, 0), (1, 0), (1, 1), (0, 1))])


SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
SIDEWAYS = np.stack([1 - SQUARE[:, 1], SQUARE[:, 0]], axis=1)


def transform(**keys: Any) -> dict[str, Any]:
    return {"extensions": {"KHR_texture_transform": keys}}


@pytest.mark.parametrize("key", ["baseColorTexture", "metallicRoughnessTexture", "normalTexture"])
@pytest.mark.parametrize(
    ("info", "expected"),
    [
        ({}, SQUARE),
        ({"texCoord": 1}, SIDEWAYS),
        (transform(texCoord=1), SIDEWAYS),
        ({"texCoord": 1, **transform(texCoord=0)}, SQUARE),
        ({"texCoord": 1, **transform(offset=[0.25, 0.0])}, SIDEWAYS - [-0.25, 0.0]),
        (transform(offset=[0.0, 0.25]), SQUARE - [0.0, 0.25]),  # glTF's v points down
        (transform(scale=[3.0, 1.0]), SQUARE * [3.0, 1.0]),
        (transform(scale=[1.0, 3.0]), SQUARE * [1.0, 3.0] - [0.0, 2.0]),  # about the upper left corner
    ],
)
def test_each_texture_has_its_own_uv(quad: Quad, key: str, info: dict[str, Any], expected: np.ndarray) -> None:
    given = {"index": 0, **info}
    material = {"name": "m", "normalTexture": given} if key == "normalTexture" else pbr(**{key: given})
    mesh = load_mesh(quad(material, picture=CODES[..., :3]))
    maps = mesh.parts[0].all_maps
    name = {"baseColorTexture": "base_color", "normalTexture": "normal"}.get(key, "roughness")
    np.testing.assert_allclose(corner_uv(mesh, maps[name]), expected, atol=1e-12)
    np.testing.assert_allclose(corner_uv(mesh, FileMap((1.0,))), SQUARE)  # the mesh's own stay
    assert {other for other, given in maps.items() if given.uv_set} <= {
        name,
        "metallic" if name == "roughness" else name,
    }


def test_textures_of_one_material_may_differ_in_their_uv(quad: Quad) -> None:
    color, gloss = {"index": 0, **transform(scale=[2, 2])}, {"index": 0, "texCoord": 1}
    material = {
        **pbr(baseColorTexture=color, metallicRoughnessTexture=gloss),
        "normalTexture": gloss,
        "alphaMode": "BLEND",
    }
    mesh = load_mesh(quad(material, picture=CODES))
    maps = mesh.parts[0].all_maps
    assert {name: given.uv_set for name, given in maps.items()} == {
        "base_color": 1,
        "alpha": 1,
        "roughness": 2,
        "metallic": 2,
        "normal": 2,
    }
    np.testing.assert_allclose(corner_uv(mesh, maps["alpha"]), SQUARE * 2 - [0, 1])
    np.testing.assert_allclose(corner_uv(mesh, maps["normal"]), SIDEWAYS)


def test_materials_of_one_name_keep_their_own_uv(tmp_path: Path, gltf_quad: Quad) -> None:
    """Two squares whose materials differ in nothing else."""
    Image.fromarray(CODES[..., :3].astype(np.uint8)).save(tmp_path / "p.png")
    attributes = {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 3}
    primitives = [{"attributes": attributes, "indices": 2, "material": number} for number in (0, 1)]
    materials = [pbr(baseColorTexture={"index": 0, "texCoord": number}) for number in (0, 1)]
    extra = {"meshes": [{"primitives": primitives}], "materials": materials, "images": [{"uri": "p.png"}]}
    mesh = load_mesh(gltf_quad(tmp_path, {}, {**extra, "textures": [{"source": 0}]}))
    assert sorted(part.texture_uv_set for part in mesh.parts) == [0, 1]
    assert len({part.name for part in mesh.parts}) == 2


def test_a_set_that_is_missing_is_zero(quad: Quad, caplog: pytest.LogCaptureFixture) -> None:
    mesh = load_mesh(quad(pbr(baseColorTexture={"index": 0, "texCoord": 2}), picture=CODES[..., :3]))
    assert not mesh.further_uv[0].any()
    assert "has a texture over TEXCOORD_2, which its mesh lacks" in caplog.text


def test_further_uv_come_back(quad: Quad, tmp_path: Path) -> None:
    turned = {"index": 0, "texCoord": 1, **transform(rotation=0.3, offset=[0.5, 0.25], scale=[2, 0.5])}
    material = {**pbr(baseColorTexture=turned), "normalTexture": {"index": 0, "texCoord": 1}}
    mesh = load_mesh(quad(material, picture=CODES[..., :3]))
    save_mesh_glb(tmp_path / "a.glb", mesh)
    again = load_mesh(tmp_path / "a.glb")
    for name, given in mesh.parts[0].all_maps.items():
        found = again.parts[0].all_maps[name]
        np.testing.assert_allclose(corner_uv(again, found), corner_uv(mesh, given), atol=1e-6, err_msg=name)
    save_mesh_glb(tmp_path / "b.glb", again)
    assert (tmp_path / "a.glb").read_bytes() == (tmp_path / "b.glb").read_bytes()


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


def test_a_picture_of_maps_over_different_uv_is_refused(tmp_path: Path) -> None:
    texture = np.zeros((2, 2, 1), np.float32)
    maps = {"roughness": FileMap((1.0,), texture), "metallic": FileMap((1.0,), texture, uv_set=1)}
    triangle, part = np.eye(3), Part("a", file_maps=maps)
    uv = triangle[None, :, :2]
    mesh = Mesh(triangle, np.array([[0, 1, 2]]), np.array([0]), (part,), uv, (uv,))
    with pytest.raises(AssetError, match=r"UV sets \[0, 1\]; wanted one set"):
        save_mesh_glb(tmp_path / "a.glb", mesh)
    with pytest.raises(AssetError, match="part 'a' has a texture over UV set 1, which the mesh does not have"):
        replace(mesh, further_uv=())


UNKNOWN = ({"gloss": FileMap((1.0,))}, {"alpha": FileMap((1.0, 0.0))}, {"alpha": FileMap((1.0,), np.zeros((2, 2, 3)))})


@pytest.mark.parametrize("maps", UNKNOWN)
def test_maps_that_files_do_not_have_are_refused(maps: dict[str, FileMap]) -> None:
    with pytest.raises(AssetError, match="part 'a' has a map"):
        Part("a", file_maps=maps)


def test_real_vehicles_are_dielectric_and_opaque(assets: Path) -> None:
    for name in ("cesium_milk_truck", "quaternius_real_suv", "kenney_sedan"):
        for part in load_mesh(assets / "cars" / f"{name}.glb").parts:
            assert factors(part) == {"roughness": (0.6,), "metallic": (0.0,)}
