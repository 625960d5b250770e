"""Maps that are looked up at other UVs than the base colour, and what becomes of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from numpy import ndarray
from squares import LEFT, RIGHT, UNIT, add_picture, altered, shown, two_squares, weathered

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.painted_texture import Model
from svbrdfgan.asset.painters import Paint
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.weather_document import Textures, weather_document
from svbrdfgan.io.gltf.accessors import append_accessor, read_floats
from svbrdfgan.io.gltf.document import Document
from svbrdfgan.types import FURTHER_MAPS, Mesh

SHADES = np.tile(np.arange(8)[:, None] * 4, (8, 1, 3))


def moved(**keys: Any) -> dict[str, Any]:
    return {"extensions": {"KHR_texture_transform": keys}}


def asset(path: Path, uv: tuple[ndarray, ndarray], pixels: ndarray, **material: Any) -> Asset:
    """Two squares with these pixels as texture 1 and this material."""

    def change(document: Document) -> None:
        add_picture(document, pixels)
        document.table("materials")[0] |= material

    return altered(two_squares(path / "a.glb", uv=uv, materials=(0, 0)), change)


def test_a_map_with_another_transform_takes_the_place_of_the_base_color_s(tmp_path: Path) -> None:
    place = moved(scale=[0.5, 1.0], offset=[0.5, 0.0])  # of the base colour: squares lie in its right half
    pbr = {"baseColorTexture": {"index": 1, **place}, "metallicRoughnessTexture": {"index": 1}}
    given = asset(tmp_path, (LEFT, RIGHT), SHADES, pbrMetallicRoughness=pbr)
    edited = weathered(given, 0, 1, alpha=0.0, size=32)
    new = edited.document.table("materials")[0]["pbrMetallicRoughness"]
    assert new["metallicRoughnessTexture"]["extensions"] == place["extensions"]
    color, gloss = (shown(edited.document, new[key]).astype(int) for key in pbr)
    # a texel at u of the base colour shows 2 u - 1 of the gloss, in whose texels of 1/8 it is bilinear
    u = 2 * (np.arange(16, 32) + 0.5) / 32 - 1
    wanted = np.interp(u * 8 - 0.5, np.arange(-1, 9), np.array([7, *range(8), 0]) * 4)
    assert np.abs(gloss[1, 16:, 1] - wanted).max() <= 2
    assert (color[1, 4:28, 0] >= color[1, 3:27, 0]).all()


def test_a_new_uv_set_has_no_transform_and_other_occlusion_stays(tmp_path: Path) -> None:
    pytest.importorskip("xatlas")
    pbr = {"baseColorTexture": {"index": 1, **moved(scale=[2.0, 2.0])}, "metallicRoughnessTexture": {"index": 1}}
    occlusion = {"index": 1, "texCoord": 1, "strength": 0.5}
    given = asset(tmp_path, (UNIT, UNIT), SHADES, pbrMetallicRoughness=pbr, occlusionTexture=occlusion)

    def second(document: Document) -> None:
        for mesh in document.table("meshes"):
            mesh["primitives"][0]["attributes"]["TEXCOORD_1"] = append_accessor(document, UNIT.astype("<f4"))

    edited = weathered(altered(given, second), 0, 1, size=32)
    material = edited.document.table("materials")[0]
    for key in pbr:
        assert set(material["pbrMetallicRoughness"][key]) == {"index", "texCoord"}
        assert material["pbrMetallicRoughness"][key]["texCoord"] == 2
    assert {**material["occlusionTexture"], "index": 1} == occlusion
    assert (shown(edited.document, material["occlusionTexture"]) == SHADES).all()


def test_uv_sets_are_numbered_without_gaps(tmp_path: Path) -> None:
    pytest.importorskip("xatlas")

    def change(document: Document) -> None:
        document.table("meshes")[0]["primitives"][0]["attributes"]["TEXCOORD_1"] = append_accessor(
            document, UNIT.astype("<f4")
        )

    edited = weathered(
        altered(two_squares(tmp_path / "a.glb", uv=(UNIT, None), materials=(0, 0)), change), 0, 1, size=32
    )
    for mesh in edited.document.table("meshes"):
        assert {f"TEXCOORD_{k}" for k in range(3)} <= set(mesh["primitives"][0]["attributes"])


def test_occlusion_in_the_red_of_the_gloss_follows_it(tmp_path: Path) -> None:
    pixels = SHADES.copy()
    pixels[..., 1:] = 255
    pbr = {"metallicRoughnessTexture": {"index": 1}}
    given = asset(
        tmp_path, (LEFT, RIGHT), pixels, pbrMetallicRoughness=pbr, occlusionTexture={"index": 1, "strength": 0.5}
    )
    edited = weathered(given, 0, 1)
    material = edited.document.table("materials")[0]
    assert material["occlusionTexture"] == {
        **material["pbrMetallicRoughness"]["metallicRoughnessTexture"],
        "strength": 0.5,
    }
    assert (shown(edited.document, material["occlusionTexture"])[..., 0] == SHADES[..., 0]).all()


def test_a_texture_that_is_mirrored_beyond_its_border_gets_a_second_uv_set(tmp_path: Path) -> None:
    pytest.importorskip("xatlas")

    def mirror(document: Document) -> None:
        document.header["samplers"] = [{"wrapS": 33648, "wrapT": 33071, "magFilter": 9728}]
        document.table("textures")[1]["sampler"] = 0

    pbr = {"baseColorTexture": {"index": 1}}
    given = altered(
        asset(tmp_path, (np.add(LEFT, (1, 0)), np.add(RIGHT, (1, 0))), SHADES, pbrMetallicRoughness=pbr), mirror
    )
    edited = weathered(given, 0, 1, alpha=0.0, size=64)
    assert "does not repeat" in edited.told[0]
    places = [given_uv(edited.document, node) for node in (0, 1)]
    color = shown(edited.document, edited.document.table("materials")[0]["pbrMetallicRoughness"]["baseColorTexture"])
    left, right = (int(color[int(v * 64), int(u * 64), 0]) for u, v in (at.mean(axis=0) for at in places))
    assert left in (20, 24)  # mirrored: what is on the right of the texture
    assert right in (4, 8)


def given_uv(document: Document, node: int) -> ndarray:
    mesh = document.table("meshes")[document.table("nodes")[node]["mesh"]]
    return read_floats(document, mesh["primitives"][0]["attributes"]["TEXCOORD_1"])


def add_tangents(document: Document) -> None:
    for mesh in document.table("meshes"):
        values = np.tile(np.array([1, 0, 0, 1], "<f4"), (4, 1))
        mesh["primitives"][0]["attributes"]["TANGENT"] = append_accessor(document, values)


TILTED = np.tile(np.array([204, 128, 230]), (8, 8, 1))


@pytest.mark.parametrize(("quarters", "wanted"), [(0, (204, 128)), (1, (128, 51)), (2, (51, 128)), (3, (128, 204))])
def test_normals_turn_with_the_frames_of_their_uvs(tmp_path: Path, quarters: int, wanted: tuple[int, int]) -> None:
    """A normal that leans along u of UVs which the file turns leans elsewhere in the frame of the base colour's."""
    info = {"index": 1, **moved(rotation=quarters * np.pi / 2)}
    given = asset(tmp_path, (LEFT, RIGHT), TILTED, normalTexture=info)
    edited = weathered(given, 0, 1, alpha=0.0)
    normal = shown(edited.document, edited.document.table("materials")[0]["normalTexture"]).astype(int)
    assert np.abs(normal[..., :2] - wanted).max() <= 2


def test_normals_stay_where_the_file_has_tangents(tmp_path: Path) -> None:
    info = {"index": 1, **moved(rotation=np.pi / 2)}
    given = asset(tmp_path, (LEFT, RIGHT), TILTED, normalTexture=info)
    edited = weathered(altered(given, add_tangents), 0, 1, alpha=0.0)
    normal = shown(edited.document, edited.document.table("materials")[0]["normalTexture"]).astype(int)
    assert np.abs(normal - TILTED[0, 0]).max() <= 2


@dataclass(frozen=True)
class Slope:
    """Paints relief that rises along x."""

    mesh: Mesh

    maps: ClassVar = FURTHER_MAPS

    def __call__(self, points: SurfacePoints, texel: float) -> Paint:
        one, height = np.ones(len(points)), 0.5 * points.positions(self.mesh)[:, 0]
        return Paint(np.zeros((len(points), 3)), one, one, one, height)


@pytest.mark.parametrize("tangents", [False, True])
def test_relief_is_painted_into_the_tangents_that_the_file_has(tmp_path: Path, tangents: bool) -> None:
    pbr = {"baseColorTexture": {"index": 1, **moved(rotation=np.pi / 2)}}
    given = asset(tmp_path, (LEFT, RIGHT), SHADES, pbrMetallicRoughness=pbr)
    given = altered(given, add_tangents) if tangents else given
    model = Model(given.mesh, np.zeros(len(given.mesh.faces), bool))
    document = weather_document(given, model, Slope(given.mesh), (0, 1), Textures(size=32, painted=512)).document
    normal = shown(document, document.table("materials")[0]["normalTexture"])[2:-2, 2:-2] / 127.5 - 1.0
    lean = normal[..., 0] if tangents else normal[..., 1]  # v of the moved UVs grows where u of the file's does
    assert np.abs(lean + 0.5 / np.sqrt(1.25)).max() < 0.02
    assert np.abs(normal[..., 2] - 1.0 / np.sqrt(1.25)).max() < 0.02
