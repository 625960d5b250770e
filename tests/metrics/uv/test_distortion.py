"""Distortion of maps whose singular values are known."""

import numpy as np
import pytest
from known_maps import cylinder, dome, flat, sheet

from svbrdfgan.metrics.uv.distortion import distortion, face_stretch, percentile, singular_values
from svbrdfgan.metrics.uv.visibility import whole_surface
from svbrdfgan.types import Surface

ALL_ONE = ("stretch_l2", "stretch_linf", "stretch_p99", "angle_mean", "angle_p99", "area_mean", "area_p99")


def ones(surface: Surface) -> dict[str, float]:
    found = vars(distortion(whole_surface(surface)))
    assert found["collapsed"] == 0.0
    return {name: found[name] for name in ALL_ONE}


@pytest.mark.parametrize("size", [0.1, 1.0, 4000.0])
def test_an_isometry_of_any_size_scores_one(size: float) -> None:
    assert ones(sheet(flat(size, size))) == pytest.approx(dict.fromkeys(ALL_ONE, 1.0), abs=1e-9)


def test_so_does_a_turned_one() -> None:
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    surface = sheet(flat(3.0, 3.0), uv=lambda st: 0.5 + 0.5 * (st - 0.5) @ turn.T)
    assert ones(surface) == pytest.approx(dict.fromkeys(ALL_ONE, 1.0), abs=1e-9)


def test_a_rectangle_over_the_square_is_stretched_by_its_sides() -> None:
    # Gamma = 3, gamma = 1, over sqrt(area) = sqrt(3)
    found = ones(sheet(flat(3.0, 1.0)))
    assert found["stretch_l2"] == pytest.approx(np.sqrt((3 + 1 / 3) / 2))
    assert [found[name] for name in ("stretch_linf", "stretch_p99")] == pytest.approx([np.sqrt(3)] * 2)
    assert [found[name] for name in ("angle_mean", "angle_p99")] == pytest.approx([(3 + 1 / 3) / 2] * 2)
    assert [found[name] for name in ("area_mean", "area_p99")] == pytest.approx([1.0] * 2)


def test_a_shear_turns_angles_and_keeps_areas() -> None:
    # [[1, 1], [0, 1]]: the squares of the singular values are (3 +- sqrt 5) / 2, and their product one
    found = ones(sheet(lambda st: np.column_stack([st[:, 0] + st[:, 1], st[:, 1], 0 * st[:, 0]])))
    assert found["stretch_l2"] == pytest.approx(np.sqrt(3 / 2))
    assert found["stretch_linf"] == pytest.approx((1 + np.sqrt(5)) / 2)
    assert found["angle_mean"] == pytest.approx(3 / 2)
    assert found["area_mean"] == pytest.approx(1.0)


def test_means_are_weighted_by_area_on_the_surface() -> None:
    """Two strips side by side: one has a quarter of the surface and half of the square."""
    surface = sheet(lambda st: np.column_stack([np.where(st[:, 0] > 0.5, 2 * st[:, 0] - 1, st[:, 0] / 2 - 0.25), st]))
    positions = np.column_stack([surface.uv[:, 0] / 2, surface.uv[:, 1], 0 * surface.uv[:, 0]])
    right = surface.uv[:, 0] > 0.5
    positions[right, 0] = 0.25 + 1.5 * (surface.uv[right, 0] - 0.5)
    found = distortion(whole_surface(Surface(**{**vars(surface), "positions": positions})))
    assert found.stretch_l2 == pytest.approx(np.sqrt(0.25 * (0.25 + 1) / 2 + 0.75 * (2.25 + 1) / 2))
    assert found.stretch_linf == pytest.approx(1.5)
    assert found.area_mean == pytest.approx(0.25 * (0.5 + 2) / 2 + 0.75 * (1.5 + 1 / 1.5) / 2)
    assert found.angle_mean == pytest.approx(0.25 * (0.5 + 2) / 2 + 0.75 * (1.5 + 1 / 1.5) / 2)
    assert found.area_p99 == pytest.approx((0.5 + 2) / 2)


def test_an_unrolled_cylinder_is_isometric() -> None:
    sides = 48
    width = 2 * sides * np.sin(np.pi / sides)  # of the polygon, for radius 1
    found = ones(sheet(cylinder(1.0, width), sides, 8))
    assert found == pytest.approx(dict.fromkeys(ALL_ONE, 1.0), abs=1e-9)


def test_the_hemispherical_map_of_half_a_sphere(hemisphere: Surface) -> None:
    """Per unit of v the sphere is pi long, per unit of u pi sin(phi); E sin = pi/4, E sin^2 = 2/3, E 1/sin = pi/2."""
    found = distortion(whole_surface(hemisphere))
    assert found.stretch_l2 == pytest.approx(np.sqrt(5 * np.pi / 12), rel=1e-3)
    assert found.stretch_linf == pytest.approx(np.sqrt(np.pi / 2), rel=1e-3)
    assert found.angle_mean == pytest.approx(3 * np.pi / 8, rel=2e-3)
    assert found.area_mean == pytest.approx((np.pi**2 / 8 + 1) / 2, rel=2e-3)


def test_sines_at_the_poles_decide_the_percentiles(hemisphere: Surface) -> None:
    """cos(phi) is uniform, so the 1 % of the area nearest to the poles has sin(phi) below sqrt(1 - 0.99^2)."""
    found, sine = distortion(whole_surface(hemisphere)), np.sqrt(1 - 0.99**2)
    assert found.angle_p99 == pytest.approx((sine + 1 / sine) / 2, rel=0.05)
    assert found.area_p99 == pytest.approx((np.pi * sine / 2 + 2 / (np.pi * sine)) / 2, rel=0.05)


def test_mirroring_changes_nothing() -> None:
    one, other = sheet(dome, 16, 16), sheet(dome, 16, 16, uv=lambda st: st * (-1, 1) + (1, 0))
    assert ones(one) == pytest.approx(ones(other))


def test_singular_values_are_those_of_the_jacobian() -> None:
    random = np.random.default_rng(0)
    jacobian, uv = random.normal(size=(200, 3, 2)), random.uniform(size=(200, 3, 2))
    largest, least = singular_values(np.einsum("fxu,fku->fkx", jacobian, uv), uv)
    truth = np.linalg.svd(jacobian, compute_uv=False)
    np.testing.assert_allclose(np.stack([largest, least], axis=1), truth, rtol=1e-6)


def test_what_is_collapsed_is_told_apart() -> None:
    surface = sheet(flat(2.0, 1.0), 2, 1, uv=lambda st: np.column_stack([np.minimum(st[:, 0], 0.5), st[:, 1]]))
    found = distortion(whole_surface(surface))
    assert found.collapsed == pytest.approx(0.5)
    assert found.stretch_l2 == pytest.approx(np.sqrt((2 + 0.5) / 2))
    assert np.isinf(face_stretch(whole_surface(surface))[0]).sum() == 2


def test_a_map_to_a_point_has_no_finite_stretch() -> None:
    found = distortion(whole_surface(sheet(flat(1.0, 1.0), uv=lambda st: 0 * st)))
    assert found.collapsed == 1.0
    assert found.stretch_l2 == np.inf


def test_percentiles_are_weighted() -> None:
    values, weights = np.array([5.0, 1.0, 3.0]), np.array([0.02, 0.9, 0.08])
    assert [percentile(values, weights, share) for share in (0.5, 0.9, 0.91, 0.98, 0.99)] == [1.0, 1.0, 3.0, 3.0, 5.0]
