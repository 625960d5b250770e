"""The glossy BSDF is glTF's, and directions are drawn with the density that is claimed."""

from itertools import pairwise

import dielectric
import numpy as np
import pytest
from numpy import ndarray
from svbrdfgan_numpy import glossy, scattering
from svbrdfgan_numpy.glossy import Cosines
from svbrdfgan_numpy.scattering import Scattering
from svbrdfgan_numpy.surface import Points

ROUGHNESSES = (0.05, 0.2, 0.5, 1.0)


def _upward(count: int, seed: int) -> ndarray:
    direction = np.random.default_rng(seed).normal(size=(count, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _points(outgoing: ndarray) -> Points:
    """Points of a surface that faces +Z."""
    count, up = len(outgoing), np.broadcast_to([0.0, 0.0, 1.0], outgoing.shape)
    return Points(np.zeros((count, 3)), outgoing, up, up, np.zeros(count, dtype=np.int64), np.zeros((count, 2)))


def _scatter(outgoing: ndarray, incoming: ndarray) -> Scattering:
    return scattering.scatter(_points(outgoing), np.arange(len(outgoing)), incoming)


def _reflected(outgoing: ndarray, incoming: ndarray, base_color: float, roughness: float) -> ndarray:
    """The BSDF times the cosine."""
    scattered = _scatter(outgoing, incoming)
    alpha = np.full(len(outgoing), roughness**2)
    return scattered.diffuse * base_color + scattered.gloss * glossy.lobe(scattered.cosines, alpha)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_it_is_the_formula_of_the_specification_and_reciprocal(roughness: float) -> None:
    """For random pairs of directions, and for light about the mirror direction."""
    view = _upward(1000, 0)
    light = np.concatenate([_upward(500, 1), _upward(500, 2) * 0.02 + view[500:] * [-1.0, -1.0, 1.0]])
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    there = _reflected(view, light, 0.8, roughness) / light[:, 2]
    back = _reflected(light, view, 0.8, roughness) / view[:, 2]
    assert np.allclose(there, dielectric.bsdf(view, light, 0.8, roughness), rtol=1e-8)
    assert np.allclose(there, back, rtol=1e-8)


def test_light_from_behind_counts_for_nothing() -> None:
    view, light = _upward(1000, 0), _upward(1000, 1) * [1.0, 1.0, -1.0]
    scattered = _scatter(view, light)
    assert (_reflected(view, light, 0.8, 0.3) == 0.0).all()
    assert (scattered.density == 0.0).all()
    assert np.isfinite(scattered.gloss).all()


@pytest.mark.parametrize("cosine", [1.0, 0.6, 0.1])
@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_drawn_directions_give_the_albedo_of_the_quadrature(cosine: float, roughness: float) -> None:
    """It is at most 1 for white, except at grazing angles, where glTF's mix of gloss and diffuse gains energy."""
    count = 100_000
    view = np.repeat(dielectric.direction(cosine), count, axis=0)
    drawn = scattering.sample(_points(view), np.arange(count), np.random.default_rng(1).random((count, 2)))
    density = _scatter(view, drawn).density
    front = density > 0.0
    for base_color in (0.0, 1.0):
        ratio = np.where(front, _reflected(view, drawn, base_color, roughness) / np.where(front, density, 1.0), 0.0)
        truth = dielectric.albedo(cosine, base_color, roughness)
        assert abs(ratio.mean() - truth) < 4.5 * ratio.std() / np.sqrt(count)
        assert ratio.std() < 4.0 * truth  # the directions suit any roughness, though they do not depend on it
    assert cosine < 0.8 or truth <= 1.0


@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.05])
def test_the_density_is_that_of_the_samples(cosine: float) -> None:
    """By chi square over sectors of rings about the mirror direction, and the directions behind the surface."""
    count, view = 100_000, dielectric.direction(cosine)
    views = np.repeat(view, count, axis=0)
    drawn = scattering.sample(_points(views), np.arange(count), np.random.default_rng(1).random((count, 2)))
    assert np.allclose(np.linalg.norm(drawn, axis=1), 1.0)
    rings, sectors = np.geomspace(1e-3, np.pi, 13), np.linspace(-np.pi, np.pi, 5)
    rings[0] = 1e-7
    angle, azimuth = _about_mirror(view[0], drawn)
    in_front = drawn[:, 2] > 0.0
    found = np.histogram2d(angle[in_front], azimuth[in_front], [rings, sectors])[0].ravel()
    wanted = count * np.array(
        [_share(view[0], ring, sector) for ring in pairwise(rings) for sector in pairwise(sectors)]
    )
    found, wanted = np.append(found, count - in_front.sum()), np.append(wanted, count - wanted.sum())
    many = wanted > 20.0
    squares = (found - wanted)[many] ** 2 / wanted[many]
    freedom = len(squares) - 1
    assert freedom > 20
    assert squares.sum() < freedom + 5.0 * np.sqrt(2.0 * freedom)  # 5 standard deviations


def _frame(view: ndarray) -> ndarray:
    """Rows: two directions across the mirror direction, and itself."""
    mirror = view * [-1.0, -1.0, 1.0]
    across = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(across, mirror), across, mirror])


def _about_mirror(view: ndarray, directions: ndarray) -> tuple[ndarray, ndarray]:
    x, y, z = _frame(view) @ directions.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _share(view: ndarray, ring: tuple[float, float], sector: tuple[float, float], nodes: int = 120) -> float:
    """The integral of the density over a piece of a ring, by midpoints in the logarithm of the angle."""
    middle = (np.arange(nodes) + 0.5) / nodes
    angle, azimuth = np.meshgrid(ring[0] * (ring[1] / ring[0]) ** middle, sector[0] + (sector[1] - sector[0]) * middle)
    angle, azimuth = angle.ravel(), azimuth.ravel()
    local = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=-1)
    density = _scatter(np.broadcast_to(view, local.shape), local @ _frame(view)).density
    area = np.log(ring[1] / ring[0]) * (sector[1] - sector[0])
    return float((density * np.sin(angle) * angle).mean() * area)


def test_the_density_of_all_half_vectors_is_1() -> None:
    """Light comes from the half vector's density over 4 w_o.h; the grid is even in the logarithm of tan^2."""
    edges = np.geomspace(1e-14, 1e10, 4001)
    tan2, one = np.sqrt(edges[1:] * edges[:-1]), np.ones(4000)
    half = 1.0 / np.sqrt(1.0 + tan2)
    solid_angle = 2.0 * np.pi * (1.0 / np.sqrt(1.0 + edges[:-1]) - 1.0 / np.sqrt(1.0 + edges[1:]))
    density = 4.0 * glossy.pdf(Cosines(outgoing=one, incoming=one, half=half, difference=one))
    assert (density * solid_angle).sum() == pytest.approx(1.0, abs=1e-4)


def test_extreme_random_numbers_give_directions() -> None:
    ends = np.array([[0.0, 0.0], [0.5 - 2**-54, 1.0 - 2**-53], [0.5, 0.0], [1.0 - 2**-53, 1.0 - 2**-53]])
    for cosine in (1.0, 0.0):
        view = np.repeat(dielectric.direction(cosine), 4, axis=0)
        drawn = scattering.sample(_points(view), np.arange(4), ends)
        assert np.allclose(np.linalg.norm(drawn, axis=1), 1.0)
        assert np.isfinite(_reflected(view, drawn, 1.0, 0.05)).all()


def test_lambertian_points_draw_and_scatter_the_same_beside_glossy_ones() -> None:
    points, random = _points(_upward(200, 0)), np.random.default_rng(1).random((200, 2))
    none, shiny, dull = np.arange(0), np.arange(0, 200, 2), np.arange(1, 200, 2)
    mixed, plain = scattering.sample(points, shiny, random), scattering.sample(points, none, random)
    assert np.array_equal(mixed[dull], plain[dull])
    assert not (mixed[shiny] == plain[shiny]).all(axis=1).any()
    scattered, lambertian = scattering.scatter(points, shiny, plain), scattering.scatter(points, none, plain)
    assert np.array_equal(scattered.density[dull], lambertian.density[dull])
    assert np.array_equal(lambertian.density, lambertian.diffuse)


@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_the_slope_of_the_lobe_is_its_derivative(roughness: float) -> None:
    cosines = glossy.cosines_between(np.array([[0.0, 0.0, 1.0]]), _upward(500, 0), _upward(500, 1))
    alpha = np.full(500, roughness**2)
    step = 1e-4 * alpha
    slope = glossy.lobe_slope(cosines, alpha)
    difference = (glossy.lobe(cosines, alpha + step) - glossy.lobe(cosines, alpha - step)) / (2.0 * step)
    assert np.allclose(slope, difference, rtol=1e-6, atol=1e-6 * np.abs(slope).max())
