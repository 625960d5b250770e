"""A second UV set is one-to-one, with gutters and one density, keeps sound islands, and is the same each time."""

import sys

import numpy as np
import pytest
import trimesh
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.ndimage import distance_transform_cdt

from svbrdfgan.asset import charts
from svbrdfgan.asset.box_charts import box_charts
from svbrdfgan.asset.charts import own_charts
from svbrdfgan.asset.islands import areas, signed_areas, uv_islands
from svbrdfgan.asset.second_uv_set import second_uv_set
from svbrdfgan.asset.uv_fitness import uv_fitness
from svbrdfgan.errors import AssetError
from svbrdfgan.geometry.rasterize import triangle_fragments

SIZE = 256
Corners = Float[ndarray, "faces 3 3"]


def corners(mesh: trimesh.Trimesh) -> Corners:
    return np.array(mesh.triangles)


def shapes() -> dict[str, Corners]:
    torus = corners(trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12))
    box, ball = corners(trimesh.creation.box()), corners(trimesh.creation.icosphere(2))
    many = np.concatenate([0.2 * box + (k % 5, k // 5, 0.0) for k in range(25)])
    return {"box": box, "ball": ball, "torus": torus, "several": np.concatenate([box + 5.0, ball, torus - 5.0, many])}


SHAPES = shapes()


def owners(uv: Float[ndarray, "faces 3 2"], positions: Corners, size: int) -> Int[ndarray, "rows cols"]:
    """The island at each texel's centre, -1 where there is none."""
    face, texel, _ = triangle_fragments(uv * size - 0.5, size, size)
    found = np.full(size * size, -1)
    found[texel] = uv_islands(positions, uv)[face]
    return found.reshape(size, size)


@pytest.fixture(params=["xatlas", "box"])
def method(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Charts by xatlas, and those of large meshes."""
    pytest.importorskip("xatlas")
    if request.param == "box":
        monkeypatch.setattr(charts, "_MOST", 0)


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.usefixtures("method")
def test_one_to_one(name: str) -> None:
    uv = second_uv_set(SHAPES[name], None, SIZE)
    assert uv.min() >= 0.0
    assert uv.max() <= 1.0
    texel = triangle_fragments(uv * SIZE - 0.5, SIZE, SIZE)[1]
    assert len(np.unique(texel)) == len(texel)
    assert uv_fitness(SHAPES[name], uv, (SIZE, SIZE)).fits


@pytest.mark.parametrize("gutter", [2, 5])
@pytest.mark.usefixtures("method")
def test_islands_are_a_gutter_apart(gutter: int) -> None:
    found = owners(second_uv_set(SHAPES["several"], None, SIZE, gutter), SHAPES["several"], SIZE)
    for island in np.unique(found[found >= 0]):
        distance = distance_transform_cdt(found != island, "chessboard")
        assert distance[(found >= 0) & (found != island)].min() > gutter


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.usefixtures("method")
def test_one_density(name: str) -> None:
    uv = second_uv_set(SHAPES[name], None, SIZE)
    density = np.sqrt(np.abs(signed_areas(uv)) / areas(SHAPES[name]))
    assert density.max() < 2.0 * density.min()


@pytest.mark.usefixtures("method")
def test_small_flat_charts_have_the_density_of_large_ones() -> None:
    """Charts of a few texels are not stretched to whole ones."""
    boxes = np.concatenate([SHAPES["box"]] + [(0.03 + 0.007 * k) * SHAPES["box"] + (2.0 * k, 2, 2) for k in range(9)])
    density = np.sqrt(np.abs(signed_areas(second_uv_set(boxes, None, SIZE))) / areas(boxes))
    assert density.max() < 1.01 * density.min()


def test_both_sides_of_a_rough_sheet_get_as_few_charts_as_one_side_alone() -> None:
    smooth = trimesh.creation.icosphere(3)
    rough = smooth.vertices * np.random.default_rng(1).uniform(0.97, 1.03, (len(smooth.vertices), 1))
    ball = rough[smooth.faces]
    both = np.concatenate([ball, ball[:, ::-1]])
    assert box_charts(both)[1].max() == 2 * (box_charts(ball)[1].max() + 1) - 1


@pytest.mark.usefixtures("method")
def test_charts_are_few() -> None:
    uv = second_uv_set(SHAPES["ball"], None, SIZE)
    assert uv_islands(SHAPES["ball"], uv).max() + 1 <= 12


def test_most_of_the_texture_is_used() -> None:
    pytest.importorskip("xatlas")
    assert np.abs(signed_areas(second_uv_set(SHAPES["torus"], None, SIZE, 2))).sum() > 0.4


@pytest.mark.usefixtures("method")
def test_the_same_each_time() -> None:
    one, other = (second_uv_set(SHAPES["several"], None, SIZE) for _ in range(2))
    assert (one == other).all()


def mirrored_pair() -> tuple[Corners, Float[ndarray, "faces 3 2"]]:
    """Two grids of 5 x 5 squares in space, the second mirrored, over one place in UV."""
    steps = np.arange(6.0) / 5.0
    grid = np.stack(np.meshgrid(steps, steps), axis=2)
    a, b, c, d = (grid[i : i + 5, j : j + 5].reshape(-1, 2) for i, j in ((0, 0), (0, 1), (1, 1), (1, 0)))
    flat = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    space = np.pad(flat, ((0, 0), (0, 0), (0, 1)))
    return np.concatenate([space, space * (-1.0, 1.0, 1.0) - (1.0, 0.0, 0.0)]), np.tile(0.2 + 0.5 * flat, (2, 1, 1))


def test_mirrored_twins_keep_their_islands_and_both_get_a_place() -> None:
    pytest.importorskip("xatlas")
    positions, uv = mirrored_pair()
    assert not uv_fitness(positions, uv, (SIZE, SIZE)).fits
    found = second_uv_set(positions, uv, SIZE)
    assert uv_fitness(positions, found, (SIZE, SIZE)).fits
    assert (np.bincount(uv_islands(positions, found)) == len(positions) // 2).all()


def test_twins_that_are_folded_on_each_other_along_their_seam_are_two_islands() -> None:
    positions, uv = mirrored_pair()
    positions[50:, :, 0] += 1.0
    positions[50:], uv[50:] = positions[50:, ::-1].copy(), uv[50:, ::-1].copy()  # both sides face one way
    assert np.bincount(own_charts(positions, uv)[1]).tolist() == [50, 50]


def test_own_islands_get_the_lengths_of_space() -> None:
    """An island that its author has sheared and scaled is one again with the surface."""
    positions, uv = mirrored_pair()
    flat, chart = own_charts(positions, uv * (0.3, 0.7) + 0.1 * uv[..., ::-1])
    assert chart.max() == 1
    lengths = [np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2) for points in (flat, positions)]
    np.testing.assert_allclose(*lengths, atol=1e-9)


def test_islands_that_stretch_are_not_kept() -> None:
    positions, uv = mirrored_pair()
    assert (own_charts(positions, uv**6)[1] < 0).all()


@pytest.mark.usefixtures("method")
def test_faces_without_area_are_points() -> None:
    """A sliver between two charts must not be a line across the texture."""
    box = SHAPES["box"]
    sliver = np.stack([box[0, 0], box[0, 0], box[0, 1]])[None]
    uv = second_uv_set(np.concatenate([box, sliver]), None, SIZE)
    assert (uv[-1] == uv[-1, 0]).all()
    assert (uv[-1, 0] == uv[:-1].reshape(-1, 2)).all(axis=1).any()


def test_an_island_over_itself_is_cut() -> None:
    """A screw: two turns of a flat spiral share a place in UV, one island though it is."""
    pytest.importorskip("xatlas")
    angle = np.linspace(0.0, 4.0 * np.pi, 65)
    inner, outer = ((np.stack([r * np.cos(angle), r * np.sin(angle), 0.2 * angle], axis=1)) for r in (1.0, 3.0))
    positions = np.concatenate(
        [np.stack([inner[:-1], outer[:-1], outer[1:]], axis=1), np.stack([inner[:-1], outer[1:], inner[1:]], axis=1)]
    )
    uv = 0.5 + positions[..., :2] / 8.0
    assert not uv_fitness(positions, uv, (SIZE, SIZE)).fits
    found = second_uv_set(positions, uv, SIZE)
    assert uv_fitness(positions, found, (SIZE, SIZE)).fits
    assert uv_islands(positions, found).max() + 1 <= 6


def test_a_long_strip_does_not_make_all_else_small() -> None:
    pytest.importorskip("xatlas")
    low, high = (np.stack([np.arange(101.0), np.full(101, y), np.zeros(101)], axis=1) for y in (0.0, 0.1))
    strip = np.concatenate(
        [np.stack([low[:-1], low[1:], high[1:]], axis=1), np.stack([low[:-1], high[1:], high[:-1]], axis=1)]
    )
    used = np.abs(signed_areas(second_uv_set(strip, None, SIZE, 1))).sum()
    assert used > 0.4  # in one piece it would be 0.001


def test_too_many_charts_say_so() -> None:
    pytest.importorskip("xatlas")
    boxes = np.concatenate([SHAPES["box"] + (2.0 * k, 0.0, 0.0) for k in range(30)])
    with pytest.raises(AssetError, match=r"180 charts do not fit 32 x 32 texels"):
        second_uv_set(boxes, None, 32)


def test_without_xatlas_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xatlas", None)
    with pytest.raises(AssetError, match=r"pip install svbrdfgan\[gltf\]"):
        second_uv_set(SHAPES["box"], None, SIZE)


def test_where_thousands_of_faces_meet_xatlas_is_not_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(charts, "import_xatlas", lambda: pytest.fail("it was"))
    around = np.linspace(0.0, 2.0 * np.pi, 1202)
    rim = np.stack([np.cos(around), np.sin(around), np.zeros_like(around)], axis=1)
    fan = np.stack([np.zeros_like(rim[1:]), rim[:-1], rim[1:]], axis=1)
    _, chart = charts.new_charts(fan)
    assert chart.min() >= 0
