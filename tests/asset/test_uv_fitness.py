"""Own UVs fit if each texel shows one place; each flaw is found and measured, and what is no flaw is none."""

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.asset.uv_fitness import ALLOWED, uv_fitness, wrapped

SIZE = (128, 128)


def quad(low: tuple[float, float], high: tuple[float, float], height: float = 0.0) -> Float[ndarray, "faces 3 3"]:
    """Two triangles over a rectangle."""
    (left, bottom), (right, top) = low, high
    corners = np.array([[left, bottom], [right, bottom], [right, top], [left, top]])
    return np.pad(corners[[[0, 1, 2], [0, 2, 3]]], ((0, 0), (0, 0), (0, 1)), constant_values=height)


def plane(low: tuple[float, float], high: tuple[float, float]) -> Float[ndarray, "faces 3 2"]:
    return quad(low, high)[..., :2]


LEFT, RIGHT = quad((0.0, 0.0), (1.0, 1.0)), quad((2.0, 0.0), (3.0, 1.0))
BOTH = np.concatenate([LEFT, RIGHT])


def test_islands_side_by_side_fit() -> None:
    uv = np.concatenate([plane((0.0, 0.0), (0.5, 1.0)), plane((0.5, 0.0), (1.0, 1.0))])
    found = uv_fitness(BOTH, uv, SIZE)
    assert found.fits
    assert found.reason == ""
    assert found.overlap == found.degenerate == found.tiling == found.palette == 0.0


def test_mirrored_twins_overlap() -> None:
    left = plane((0.1, 0.1), (0.4, 0.4))
    found = uv_fitness(BOTH, np.concatenate([left, left * (-1.0, 1.0) + (0.5, 0.0)]), SIZE)
    assert not found.fits
    assert found.overlap == pytest.approx(1.0)
    assert found.reason == "islands overlap (100 % of the area)"


def test_overlap_is_the_share_of_the_area_in_space() -> None:
    uv = np.concatenate([plane((0.0, 0.0), (0.5, 0.5)), plane((0.25, 0.0), (0.75, 0.5))])
    assert uv_fitness(BOTH, uv, SIZE).overlap == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("gap", [0.0, 1e-4])
def test_both_sides_of_a_sheet_are_one_place(gap: float) -> None:
    sheet = np.concatenate([LEFT, LEFT[:, ::-1] + (0.0, 0.0, gap)])
    uv = plane((0.1, 0.1), (0.9, 0.9))
    assert uv_fitness(sheet, np.concatenate([uv, uv[:, ::-1]]), SIZE).fits


def test_a_distant_second_layer_is_another_place() -> None:
    layers = np.concatenate([LEFT, quad((0.0, 0.0), (1.0, 1.0), height=0.2)])
    uv = plane((0.1, 0.1), (0.9, 0.9))
    assert not uv_fitness(layers, np.concatenate([uv, uv]), SIZE).fits


def test_few_texels_do_not_make_distant_places_one() -> None:
    """Where a texel is as wide as the gap between two parts, they are two places all the same."""
    layers = np.concatenate([LEFT, quad((0.0, 0.0), (1.0, 1.0), height=0.5)])
    uv = plane((0.1, 0.1), (0.2, 0.2))
    assert uv_fitness(layers, np.concatenate([uv, uv]), (16, 16)).overlap == pytest.approx(1.0)


def test_islands_in_another_tile_fit_after_a_shift() -> None:
    uv = np.concatenate([plane((0.0, 0.0), (0.5, 1.0)), plane((1.5, -3.0), (2.0, -2.0))])
    assert uv_fitness(BOTH, uv, SIZE).fits
    np.testing.assert_allclose(wrapped(uv)[2:], plane((0.5, 0.0), (1.0, 1.0)), atol=1e-12)


def test_islands_in_another_tile_can_overlap_after_the_shift() -> None:
    uv = plane((0.0, 0.0), (0.5, 1.0))
    assert uv_fitness(BOTH, np.concatenate([uv, uv + 1.0]), SIZE).overlap == pytest.approx(1.0)


def test_an_island_moves_as_a_whole() -> None:
    uv = plane((4.0, 2.0), (5.0, 3.0))
    np.testing.assert_allclose(wrapped(uv), uv - (4.0, 2.0), atol=1e-12)


@pytest.mark.parametrize("uv", [plane((0.0, 0.0), (3.0, 0.5)), plane((0.5, 0.0), (1.4, 0.5))])
def test_a_face_across_a_border_is_tiling(uv: Float[ndarray, "faces 3 2"]) -> None:
    found = uv_fitness(LEFT, uv, SIZE)
    assert not found.fits
    assert found.tiling == pytest.approx(1.0)


def test_parts_of_one_colour_are_a_palette() -> None:
    uv = np.concatenate([np.full((2, 3, 2), 0.3), plane((0.6, 0.6), (0.601, 0.601))])
    found = uv_fitness(BOTH, uv, SIZE)
    assert not found.fits
    assert found.palette == pytest.approx(1.0)
    assert "palette" in found.reason


def test_a_face_without_area_in_uv_beside_sound_ones_is_degenerate() -> None:
    space = np.concatenate([quad((0.0, 0.0), (9.0, 1.0)), quad((10.0, 0.0), (11.0, 1.0))])
    uv = np.concatenate([plane((0.0, 0.0), (0.9, 0.9)), np.full((2, 3, 2), 0.95)])
    found = uv_fitness(space, uv, SIZE)
    assert not found.fits
    assert found.degenerate == pytest.approx(0.1)
    assert found.palette == 0.0


def test_what_is_allowed_is_a_small_share() -> None:
    sliver = quad((1.0, 0.0), (1.0 + 0.5 * ALLOWED, 1.0))
    uv = np.concatenate([plane((0.0, 0.0), (0.9, 0.9)), np.full((2, 3, 2), 0.95)])
    assert uv_fitness(np.concatenate([LEFT, sliver]), uv, SIZE).fits


def test_no_uvs_do_not_fit() -> None:
    assert uv_fitness(LEFT, None, SIZE).reason == "no UVs"


def test_a_texture_repeated_many_times_costs_no_more() -> None:
    """Two thousand faces that each fill the square: their fragments are bounded, and the overlap is still found."""
    space = np.concatenate([quad((2.0 * k, 0.0), (2.0 * k + 1.0, 1.0)) for k in range(1000)])
    uv = np.tile(plane((0.0, 0.0), (1.0, 1.0)), (1000, 1, 1))
    assert uv_fitness(space, uv, (1024, 1024)).overlap == pytest.approx(1.0)
