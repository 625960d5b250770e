"""Masks of the user's: where a layer may lie, and which pieces weather for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy import ndarray
from PIL import Image
from squares import LEFT, RIGHT, UNIT, Halves, altered, two_squares

from svbrdfgan.asset.asset import Asset
from svbrdfgan.asset.masks import Mask, MaskedPainter, masked_pieces
from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.asset.verdicts import Verdict, judge
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document


@pytest.fixture
def asset(tmp_path: Path) -> Asset:
    """Two squares, of the materials `paint` and `other`, over the left and the right half of a texture."""
    return two_squares(tmp_path / "a.glb", uv=(LEFT, RIGHT), materials=(0, 1))


def saved(path: Path, pixels: ndarray) -> str:
    Image.fromarray(pixels.astype(np.uint8)).save(path)
    return str(path)


def at(asset: Asset, x: float, y: float) -> SurfacePoints:
    """The point of the squares at a place."""
    corners = asset.mesh.positions[asset.mesh.faces][:, :, :2]
    for face, corner in enumerate(corners):
        weights = np.linalg.solve(np.vstack([corner.T, np.ones(3)]), (x, y, 1.0))
        if weights.min() >= -1e-9:
            return SurfacePoints(np.array([face]), weights[None])
    raise AssertionError("beside the squares")


def with_attribute(asset: Asset, name: str, values: ndarray, piece: int = 0, **keys: object) -> Asset:
    def change(document: Document) -> None:
        mesh = document.table("meshes")[document.table("nodes")[piece]["mesh"]]
        mesh["primitives"][0]["attributes"][name] = append_accessor(document, values, **keys)

    return altered(asset, change)


def verdicts(asset: Asset, *words: str, **asked: tuple[str, ...]) -> tuple[Verdict, ...]:
    return judge(asset, masked=masked_pieces(asset, [Mask.read(word) for word in words]), **asked)


def test_a_picture_lies_upright_over_the_uvs_and_is_interpolated(asset: Asset, tmp_path: Path) -> None:
    top_left = np.zeros((4, 4))
    top_left[0, 0] = 255
    mask = Mask.read(saved(tmp_path / "m.png", top_left)).on(asset)
    # the texel's centre lies at u = 1/8, v = 7/8, which the left square shows a quarter from its left edge
    assert mask(at(asset, -0.75, 0.875)) == pytest.approx(1.0)
    assert mask(at(asset, -0.5, 0.875)) == pytest.approx(0.5)
    assert mask(at(asset, -0.75, 0.75)) == pytest.approx(0.5)
    assert mask(at(asset, -0.75, 0.2)) == 0.0


def test_grey_is_the_number_that_the_file_stores(asset: Asset, tmp_path: Path) -> None:
    word = saved(tmp_path / "m.png", np.full((2, 2), 51))
    assert Mask.read(word).on(asset)(at(asset, 0.5, 0.5)) == pytest.approx(0.2)
    sixteen = tmp_path / "n.png"
    Image.fromarray(np.full((2, 2), 13107, np.uint16)).save(sixteen)
    assert Mask.read(str(sixteen)).on(asset)(at(asset, 0.5, 0.5)) == pytest.approx(0.2)


def test_a_vertex_attribute_is_interpolated_over_the_face(asset: Asset) -> None:
    worn = with_attribute(asset, "_WEAR", np.array([0, 255, 255, 0], np.uint8), normalized=True)
    mask = Mask.read("_WEAR").on(worn)
    assert mask(at(worn, -0.75, 0.5)) == pytest.approx(0.25)
    assert mask(at(worn, 0.5, 0.5)) == 1.0
    colored = with_attribute(asset, "COLOR_1", np.tile(np.array([[0.5, 0.0, 0.0, 1.0]], "<f4"), (4, 1)), 1)
    assert Mask.read("COLOR_1").on(colored)(at(colored, 0.5, 0.5)) == pytest.approx(0.5)


def test_a_mask_decides_which_pieces_weather(asset: Asset, tmp_path: Path) -> None:
    left = np.zeros((8, 8))
    left[:, :3] = 255
    word = saved(tmp_path / "m.png", left)
    first, second = verdicts(asset, word, learnable=("other",))
    assert (first.weathers, first.reason) == (True, "the mask")
    assert (second.weathers, second.reason) == (False, "the mask")
    plain = judge(asset)
    assert verdicts(asset, f"PAI*={word}")[1] == plain[1]
    assert verdicts(asset, word, keep=("paint",))[0].reason == "--keep 'paint'"


def test_where_two_masks_lie_both_must_be_free(asset: Asset, tmp_path: Path) -> None:
    white, black = (saved(tmp_path / f"{grey}.png", np.full((2, 2), grey)) for grey in (255, 0))
    first, second = verdicts(asset, white, f"paint={black}")
    assert not first.weathers
    assert second.weathers


@pytest.mark.parametrize("side", [64, 3000])
def test_a_small_spot_inside_a_large_face_is_found(asset: Asset, tmp_path: Path, side: int) -> None:
    spot = np.zeros((side, side))
    middle = int(0.7 * side)
    spot[middle : middle + 3, side // 5 : side // 5 + 3] = 255
    first, second = verdicts(asset, saved(tmp_path / "m.png", spot))
    assert (first.weathers, second.weathers) == (True, False)


def test_pictures_repeat(tmp_path: Path) -> None:
    asset = two_squares(tmp_path / "a.glb", uv=(UNIT * 2.0 - 0.5, None), materials=(0, 1))
    left = np.zeros((16, 16))
    left[4:6, 4:6] = 255
    word = saved(tmp_path / "m.png", left)
    mask = Mask.read(word).on(asset)
    u, v = 5 / 16, 1 - 5 / 16
    places = [(-1 + (u + tile + 0.5) / 2, (v + 0.5) / 2) for tile in (0, 1)]
    assert [float(mask(at(asset, *place))[0]) for place in places] == pytest.approx([1.0, 1.0])
    assert verdicts(asset, word)[0].weathers
    assert verdicts(asset, word)[1] == judge(asset)[1]


def test_the_layer_s_alpha_is_multiplied_by_all_masks(asset: Asset, tmp_path: Path) -> None:
    grey = saved(tmp_path / "m.png", np.full((2, 2), 51))
    masks = [Mask.read(word).on(asset) for word in (grey, f"other={grey}")]
    painter = MaskedPainter(Halves(asset.mesh, 0.5), masks)
    assert painter(at(asset, 0.5, 0.5), 0.1).alpha == pytest.approx(0.5 * 0.2 * 0.2)
    assert painter(at(asset, -0.5, 0.5), 0.1).alpha == 0.0


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("rusty", "neither a picture"),
        ("missing.png", "missing.png does not exist"),
        ("_WEAR", "no part has the vertex attribute _WEAR, but POSITION, TEXCOORD_0"),
        ("chrome=COLOR_1", "no material's name matches 'chrome', of paint, other"),
    ],
)
def test_what_cannot_be_is_told(asset: Asset, word: str, said: str) -> None:
    with pytest.raises((AssetError, ConfigError), match=said.replace("'", ".")):
        Mask.read(word).on(asset)


def test_pictures_need_uvs(tmp_path: Path) -> None:
    bare = two_squares(tmp_path / "a.glb", uv=(None, None), materials=(0, 1))
    with pytest.raises(ConfigError, match="a picture needs UVs"):
        Mask.read(saved(tmp_path / "m.png", np.ones((2, 2)))).on(bare)
    broken = tmp_path / "b.png"
    broken.write_text("no picture")
    with pytest.raises(AssetError, match="cannot be read as a picture"):
        Mask.read(str(broken))
