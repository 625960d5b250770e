"""Own UVs: kept bit for bit where they are good, mended where they are not."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from layouts import assert_one_to_one, mesh_with, sheet, sheets, small
from svbrdfgan_given import GivenEmbedding
from svbrdfgan_given.charts import find_charts, signed_areas

from svbrdfgan.errors import AssetError, ConfigError, EmbeddingError
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.testing.embedding.meshes import body, clutter
from svbrdfgan.types import Mesh

GIVEN = GivenEmbedding()


def given_uv(mesh: Mesh) -> np.ndarray:
    surface = GIVEN.embed(mesh)
    return surface.uv[surface.faces]


@pytest.mark.parametrize("make", [body, clutter, lambda: sheets(small(0.4), small(0.4, (0.55, 0.5)))])
def test_good_uvs_come_back_bit_for_bit(make) -> None:  # type: ignore[no-untyped-def]
    mesh = make()
    np.testing.assert_array_equal(given_uv(mesh), mesh.uv)


def test_the_last_bits_survive() -> None:
    """Neighbours whose UVs differ by less than anything a texture can show are not merged."""
    positions, faces, uv = sheet()
    uv = 0.1 + 0.8 * uv + np.random.default_rng(0).uniform(0, 1e-9, uv.shape)
    np.testing.assert_array_equal(given_uv(mesh_with(positions, faces, uv)), uv)


def test_the_borders_of_the_square_are_inside() -> None:
    positions, faces, uv = sheet()
    np.testing.assert_array_equal(given_uv(mesh_with(positions, faces, uv)), uv)


def test_bob_is_kept_and_spot_is_mended(assets: Path) -> None:
    bob, spot = (load_mesh(assets / "meshes" / f"{name}_uv.obj") for name in ("bob", "spot"))
    np.testing.assert_array_equal(given_uv(bob), bob.uv)
    assert (signed_areas(spot.uv) < 0).sum() == 177  # an ear is mirrored
    assert_one_to_one(GIVEN.embed(spot))


def test_a_mesh_without_uvs_is_refused() -> None:
    with pytest.raises(EmbeddingError, match="no UVs of its own; export it with UVs"):
        GIVEN.embed(replace(body(), uv=None))


@pytest.mark.parametrize("factor", [(0.0, 0.0), (1.0, 0.0)])
def test_uvs_without_area_are_refused(factor: tuple[float, float]) -> None:
    mesh = body()
    with pytest.raises(EmbeddingError, match="have no area"):
        GIVEN.embed(replace(mesh, uv=mesh.uv * factor))


def test_uvs_that_are_no_numbers_never_reach_an_embedding() -> None:
    with pytest.raises(AssetError, match="not finite"):
        replace(body(), uv=np.full((len(body().faces), 3, 2), np.nan))


def test_charts_in_other_tiles_come_home_unchanged() -> None:
    one, other = small(0.4), small(0.4, (0.55, 0.5))
    uv = given_uv(sheets(one + np.array([3, -2]), other + np.array([0, 7])))
    np.testing.assert_allclose(uv, np.concatenate([one, other]), atol=1e-12)


def test_charts_of_two_tiles_that_meet_at_home_are_parted() -> None:
    mesh = sheets(small(), small(0.4, (1.05, 0.05)))
    assert_one_to_one(GIVEN.embed(mesh))


def test_a_chart_that_spans_tiles_is_scaled() -> None:
    positions, faces, uv = sheet()
    np.testing.assert_allclose(given_uv(mesh_with(positions, faces, 3 * uv - 1)), uv, atol=1e-12)


def test_a_layout_that_sticks_out_is_scaled_as_one() -> None:
    one, other = small(0.4, (-0.05, 0.0)), small(0.4, (0.6, 0.6))
    uv = given_uv(sheets(one, other))
    low, high = one.min(), other.max()
    np.testing.assert_allclose(uv, (np.concatenate([one, other]) - (low, 0.0)) / (high - low), atol=1e-12)


def test_a_mirrored_chart_is_turned_over_in_its_place() -> None:
    one, other = small(0.4), small(0.4, (0.55, 0.5))
    mirrored = other * (-1, 1) + (2 * 0.75, 0)
    uv = given_uv(sheets(one, mirrored))
    np.testing.assert_array_equal(uv[: len(one)], one)
    np.testing.assert_allclose(uv[len(one) :], other, atol=1e-12)


def test_stacked_charts_are_packed_alike_with_gutters() -> None:
    mesh = sheets(*[small(0.8, (0.1, 0.1))] * 5)
    surface = GIVEN.embed(mesh)
    assert_one_to_one(surface)
    boxes = surface.uv[surface.faces].reshape(5, -1, 2)
    low, high = boxes.min(axis=1), boxes.max(axis=1)
    np.testing.assert_allclose(high - low, (high - low)[0, 0], rtol=1e-9)
    assert (high - low)[0, 0] > 0.3  # five squares in one: three shelves of two, less gutters
    gaps = np.maximum(low[:, None] - high[None], low[None] - high[:, None]).max(axis=2)
    assert gaps[~np.eye(5, dtype=bool)].min() >= 2 / 256 - 1e-12


def test_packed_charts_keep_their_shape() -> None:
    mesh = sheets(*[small(0.8, (0.1, 0.1))] * 2)
    uv = given_uv(mesh)[: len(sheet()[1])]
    shape = uv - uv.min(axis=(0, 1))
    np.testing.assert_allclose(shape / shape.max(), sheet()[2], atol=1e-9)


def test_a_chart_that_winds_over_itself_is_cut() -> None:
    """A fan of 600 degrees about one point."""
    around = np.linspace(0, np.radians(600), 41)
    ring = np.column_stack([np.cos(around), np.sin(around)])
    positions = np.concatenate([np.column_stack([ring, around]), [[0, 0, 0]]])
    faces = np.stack([np.full(40, 41), np.arange(40), np.arange(1, 41)], axis=1)
    flat = np.concatenate([ring, [[0, 0]]]) * 0.4 + 0.5
    surface = GIVEN.embed(mesh_with(positions, faces, flat[faces]))
    assert_one_to_one(surface)
    assert find_charts(faces, surface.uv[surface.faces]).max() + 1 == 2


def test_a_fold_is_parted_and_turned() -> None:
    positions = np.array([[x, y, 0.0] for y in (0.0, 1.0) for x in range(4)])
    faces = np.array([[a, b, c] for x in range(3) for a, b, c in ((x, x + 1, x + 5), (x, x + 5, x + 4))])
    uv = np.column_stack([np.tile([0.1, 0.6, 0.1, 0.6], 2), np.repeat([0.0, 1.0], 4)])[faces]
    assert_one_to_one(GIVEN.embed(mesh_with(positions, faces, uv)))


def test_faces_without_uv_area_get_half_a_texel() -> None:
    mesh = sheets(small(), np.full_like(small(), 0.7))
    surface = GIVEN.embed(mesh)
    assert_one_to_one(surface)
    area = signed_areas(surface.uv[surface.faces])
    np.testing.assert_allclose(area[len(area) // 2 :] * 256**2, 0.5 * 0.7**2, rtol=1e-6)
    assert area[: len(area) // 2].sum() > 0.6


def test_points_in_uv_do_not_matter_where_there_is_nothing_to_see() -> None:
    positions, faces, uv = sheet()
    faces, uv = np.concatenate([faces, [[0, 0, 1]]]), np.concatenate([0.9 * uv, np.full((1, 3, 2), 0.3)])
    np.testing.assert_array_equal(given_uv(mesh_with(positions, faces, uv)), uv)


@pytest.mark.parametrize("seed", range(5))
def test_any_uvs_become_one_to_one(seed: int) -> None:
    """A bumpy sheet with UVs by chance: folded, mirrored, stacked and spread over tiles."""
    random = np.random.default_rng(seed)
    positions, faces, uv = sheet(6)
    moved = np.column_stack([positions[:, :2] + random.normal(scale=0.12, size=(len(positions), 2))])
    uv = moved[faces] * random.uniform(0.5, 2) * np.where(random.random(len(faces)) < 0.3, -1, 1)[:, None, None]
    assert_one_to_one(GIVEN.embed(mesh_with(positions, faces, uv)))


def test_more_charts_than_texels_are_refused() -> None:
    with pytest.raises(EmbeddingError, match="16 charts and 0 faces without area, which do not fit 8 texels"):
        GivenEmbedding(resolution=8).embed(sheets(*[small()] * 16))


@pytest.mark.parametrize("options", [{"resolution": 0}, {"gutter": -1.0}, {"gutter": float("nan")}, {"gutter": 200.0}])
def test_impossible_options_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(options))):
        GivenEmbedding(**options)  # type: ignore[arg-type]
