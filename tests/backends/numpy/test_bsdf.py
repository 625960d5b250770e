"""The BSDF is glTF's, its derivatives are right, and directions are drawn with the density that is claimed."""

from dataclasses import replace
from itertools import pairwise

import gltf
import numpy as np
import pytest
from numpy import ndarray
from svbrdfgan_numpy.bsdf import EVEN, Bsdf

ROUGHNESSES = (0.05, 0.2, 0.5, 1.0)
MATERIALS = [(0.2, 0.0), (0.2, 1.0), (0.6, 0.5), (0.05, 0.0), (1.0, 1.0)]
"""Roughness and metallic."""

UP = np.array([0.0, 0.0, 1.0])


def _upward(count: int, seed: int) -> ndarray:
    direction = np.random.default_rng(seed).normal(size=(count, 3))
    direction[:, 2] = np.abs(direction[:, 2])
    return direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _bsdf(
    count: int, base_color: float = 0.5, roughness: float = 0.3, metallic: float = 0.0, *, mapped: bool = False
) -> Bsdf:
    """Of points that face +Z and are all glossy; `mapped` says whether a normal map tells them so."""
    return Bsdf(
        np.arange(count),
        np.full((count, 3), base_color),
        np.full(count, roughness),
        np.full(count, metallic),
        np.broadcast_to(UP, (count, 3)),
        np.arange(count if mapped else 0),
    )


@pytest.mark.parametrize("metallic", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("roughness", ROUGHNESSES)
def test_it_is_the_formula_of_the_specification_and_reciprocal(roughness: float, metallic: float) -> None:
    """For random pairs of directions, and for light about the mirror direction."""
    view = _upward(1000, 0)
    light = np.concatenate([_upward(500, 1), _upward(500, 2) * 0.02 + view[500:] * [-1.0, -1.0, 1.0]])
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    bsdf = _bsdf(1000, 0.8, roughness, metallic)
    there = bsdf.evaluate(view, light) / light[:, 2:]
    back = bsdf.evaluate(light, view) / view[:, 2:]
    truth = gltf.bsdf(view, light, 0.8, roughness, metallic)
    assert np.allclose(there, truth[:, None], rtol=1e-8)
    assert np.allclose(there, back, rtol=1e-8)


def test_each_channel_of_a_metal_has_its_own_colour() -> None:
    view, light = _upward(100, 0), _upward(100, 1)
    tinted = replace(_bsdf(100, 0.5, 0.4, 0.7), base_color=np.broadcast_to([0.9, 0.5, 0.1], (100, 3)))
    found = tinted.evaluate(view, light) / light[:, 2:]
    for channel, color in enumerate((0.9, 0.5, 0.1)):
        assert np.allclose(found[:, channel], gltf.bsdf(view, light, color, 0.4, 0.7))


def test_light_from_behind_counts_for_nothing() -> None:
    view, light = _upward(1000, 0), _upward(1000, 1) * [1.0, 1.0, -1.0]
    bsdf = _bsdf(1000)
    assert (bsdf.evaluate(view, light) == 0.0).all()
    assert (bsdf.pdf(view, light) == 0.0).all()
    gradient = bsdf.evaluate_vjp(view, light, np.ones((1000, 3)))
    assert not any(values.any() for values in vars(gradient).values())


def test_behind_a_normal_the_viewer_draws_by_the_cosine_and_sees_as_from_its_horizon() -> None:
    """Smith's term is that of n . w_o = 0; the diffuse share is as ever."""
    view, light, random = -_upward(1000, 0), _upward(1000, 1), np.random.default_rng(2).random((1000, 2))
    bsdf, plain = _bsdf(1000, roughness=0.5), replace(_bsdf(1000), glossy=np.arange(0))
    assert np.array_equal(bsdf.sample(view, random), plain.sample(view, random))
    assert np.array_equal(bsdf.pdf(view, light), plain.pdf(view, light))
    half = (view + light) / np.linalg.norm(view + light, axis=1, keepdims=True)
    alpha2, cosine = 0.5**4, light[:, 2]
    d = alpha2 / (np.pi * (np.maximum(half[:, 2], 0.0) ** 2 * (alpha2 - 1.0) + 1.0) ** 2)
    g_over_cosines = 2.0 / np.sqrt(alpha2) * 2.0 / (cosine + np.sqrt(alpha2 + (1.0 - alpha2) * cosine**2))
    fresnel = 0.04 + 0.96 * (1.0 - (half * view).sum(axis=1)) ** 5
    truth = ((1.0 - fresnel) * 0.5 / np.pi + fresnel * d * g_over_cosines / 4.0) * cosine
    assert np.allclose(bsdf.evaluate(view, light), truth[:, None])


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("cosine", [1.0, 0.6, 0.1])
@pytest.mark.parametrize(("roughness", "metallic"), MATERIALS)
def test_drawn_directions_give_the_albedo_of_the_quadrature(
    cosine: float, roughness: float, metallic: float, mapped: bool
) -> None:
    """It is at most 1 for white, except at grazing angles, where glTF's mix of gloss and diffuse gains energy."""
    count = 25_000
    view = np.repeat(gltf.direction(cosine), count, axis=0)
    for base_color in (0.1, 1.0):
        bsdf = _bsdf(count, base_color, roughness, metallic, mapped=mapped)
        drawn = bsdf.sample(view, np.random.default_rng(1).random((count, 2)))
        density = bsdf.pdf(view, drawn)
        front = density > 0.0
        ratio = np.where(front, bsdf.evaluate(view, drawn)[:, 0] / np.where(front, density, 1.0), 0.0)
        truth = gltf.albedo(cosine, base_color, roughness, metallic)
        assert abs(ratio.mean() - truth) < 4.5 * ratio.std() / np.sqrt(count)
        assert ratio.std() < 3.0 * truth
    assert cosine < 0.8 or truth <= 1.0


@pytest.mark.parametrize("mapped", [False, True])
@pytest.mark.parametrize("cosine", [1.0, 0.5, 0.05])
@pytest.mark.parametrize(("roughness", "metallic"), MATERIALS)
def test_the_density_is_that_of_the_samples(cosine: float, roughness: float, metallic: float, mapped: bool) -> None:
    """By chi square over sectors of rings about the mirror direction, and the directions behind the surface."""
    count, view = 25_000, gltf.direction(cosine)
    bsdf = _bsdf(count, 0.5, roughness, metallic, mapped=mapped)
    drawn = bsdf.sample(np.repeat(view, count, axis=0), np.random.default_rng(1).random((count, 2)))
    assert np.allclose(np.linalg.norm(drawn, axis=1), 1.0)
    rings, sectors = np.geomspace(1e-3, np.pi, 13), np.linspace(-np.pi, np.pi, 5)
    rings[0] = 1e-7
    angle, azimuth = _about_mirror(view[0], drawn)
    in_front = drawn[:, 2] > 0.0
    found = np.histogram2d(angle[in_front], azimuth[in_front], [rings, sectors])[0].ravel()
    wanted = count * np.array(
        [_share(bsdf, view[0], ring, sector) for ring in pairwise(rings) for sector in pairwise(sectors)]
    )
    found, wanted = np.append(found, count - in_front.sum()), np.append(wanted, count - wanted.sum())
    many = wanted > 20.0
    squares = (found - wanted)[many] ** 2 / wanted[many]
    freedom = len(squares) - 1
    assert freedom > 10
    assert squares.sum() < freedom + 5.0 * np.sqrt(2.0 * freedom)  # 5 standard deviations


def _frame(view: ndarray) -> ndarray:
    """Rows: two directions across the mirror direction, and itself."""
    mirror = view * [-1.0, -1.0, 1.0]
    across = np.array([0.0, 1.0, 0.0])
    return np.stack([np.cross(across, mirror), across, mirror])


def _about_mirror(view: ndarray, directions: ndarray) -> tuple[ndarray, ndarray]:
    x, y, z = _frame(view) @ directions.T
    return np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)


def _share(bsdf: Bsdf, view: ndarray, ring: tuple[float, float], sector: tuple[float, float], nodes: int = 80) -> float:
    """The integral of the density over a piece of a ring, by midpoints in the logarithm of the angle."""
    middle = (np.arange(nodes) + 0.5) / nodes
    angle, azimuth = np.meshgrid(ring[0] * (ring[1] / ring[0]) ** middle, sector[0] + (sector[1] - sector[0]) * middle)
    angle, azimuth = angle.ravel(), azimuth.ravel()
    local = np.stack([np.sin(angle) * np.cos(azimuth), np.sin(angle) * np.sin(azimuth), np.cos(angle)], axis=-1)
    alike = _bsdf(len(local), 0.5, bsdf.roughness[0], bsdf.metallic[0], mapped=len(bsdf.mapped) > 0)
    density = alike.pdf(np.broadcast_to(view, local.shape), local @ _frame(view))
    area = np.log(ring[1] / ring[0]) * (sector[1] - sector[0])
    return float((density * np.sin(angle) * angle).mean() * area)


@pytest.mark.parametrize("metallic", [None, 0.0, 1.0])
def test_the_slope_in_a_normal_has_bounded_weights(metallic: float | None) -> None:
    """At the horizon of n the cosine vanishes, and so does a density by it alone, but not the slope."""
    count, view = 100_000, np.repeat(gltf.direction(0.6), 100_000, axis=0)
    bsdf = _bsdf(count, roughness=0.3, metallic=metallic or 0.0, mapped=True)
    if metallic is None:
        bsdf = replace(bsdf, glossy=np.arange(0))
    drawn = bsdf.sample(view, np.random.default_rng(1).random((count, 2)))
    front = drawn[:, 2] > 0.0
    assert drawn[front, 2].min() < 1e-3
    assert bsdf.pdf(view, drawn)[front].min() >= 0.1 * EVEN / (2.0 * np.pi) * (1.0 - 1e-9)


def test_extreme_random_numbers_give_directions() -> None:
    ends = np.array([[0.0, 0.0], [0.5 - 2**-54, 1.0 - 2**-53], [0.5, 0.0], [1.0 - 2**-53, 1.0 - 2**-53]])
    for cosine in (1.0, 1e-9, 0.0):
        view = np.repeat(gltf.direction(cosine), 4, axis=0)
        for metallic in (0.0, 1.0):
            bsdf = _bsdf(4, 1.0, 0.0, metallic)
            drawn = bsdf.sample(view, ends)
            assert np.allclose(np.linalg.norm(drawn, axis=1), 1.0)
            assert np.isfinite(bsdf.evaluate(view, drawn)).all()
            assert np.isfinite(bsdf.pdf(view, drawn)).all()
            gradient = bsdf.evaluate_vjp(view, drawn, np.ones((4, 3)))
            assert all(np.isfinite(values).all() for values in vars(gradient).values())


def test_lambertian_points_draw_and_scatter_the_same_beside_glossy_ones() -> None:
    """With the values of roughness and metallic that points without these maps are given."""
    view, random, shiny, dull = (
        _upward(200, 0),
        np.random.default_rng(1).random((200, 2)),
        *np.arange(200).reshape(2, -1),
    )
    mixed = replace(_bsdf(200), glossy=shiny)
    plain = replace(mixed, glossy=np.arange(0))
    drawn = plain.sample(view, random)
    assert np.array_equal(mixed.sample(view, random)[dull], drawn[dull])
    assert not (mixed.sample(view, random) == drawn).all(axis=1)[shiny].all()
    assert np.array_equal(mixed.pdf(view, drawn)[dull], plain.pdf(view, drawn)[dull])
    assert np.array_equal(mixed.evaluate(view, drawn)[dull], plain.evaluate(view, drawn)[dull])
    assert np.allclose(plain.evaluate(view, drawn), 0.5 * plain.pdf(view, drawn)[:, None], rtol=1e-14)


def _some_points(count: int) -> tuple[Bsdf, ndarray, ndarray]:
    """Points of all kinds, every fourth Lambertian, with normals off +Z, and pairs of directions."""
    random = np.random.default_rng(3)
    bsdf = Bsdf(
        np.flatnonzero(np.arange(count) % 4),
        random.random((count, 3)),
        random.uniform(0.06, 1.0, count),
        random.random(count),
        _upward(count, 4) * [0.5, 0.5, 1.0],
        np.arange(0, count, 2),
    )
    bsdf = replace(bsdf, normal=bsdf.normal / np.linalg.norm(bsdf.normal, axis=1, keepdims=True))
    view = _upward(count, 5) * np.where(np.arange(count) % 10, 1.0, -1.0)[:, None]  # some from behind
    return bsdf, view, _upward(count, 6)


@pytest.mark.parametrize("name", ["base_color", "roughness", "metallic", "normal"])
def test_the_gradient_is_the_derivative(name: str) -> None:
    """At each point, along a random direction, by central differences of fourth order."""
    count, random = 2000, np.random.default_rng(7)
    bsdf, view, light = _some_points(count)
    grad, along = random.normal(size=(count, 3)), random.normal(size=getattr(bsdf, name).shape)

    def change(step: float) -> ndarray:
        there, back = (
            replace(bsdf, **{name: getattr(bsdf, name) + s * along}).evaluate(view, light) for s in (step, -step)
        )
        return ((there - back) * grad).sum(axis=1) / (2.0 * step)

    slope = (4.0 * change(2e-5) - change(4e-5)) / 3.0
    gradient = getattr(bsdf.evaluate_vjp(view, light, grad), name)
    found = (gradient * along).reshape(count, -1).sum(axis=1)
    assert np.abs(found).max() > 0.1
    kinks = [np.abs((bsdf.normal * direction).sum(axis=1)) < 1e-3 for direction in (light, view, light + view)]
    smooth = ~np.any(kinks, axis=0)  # elsewhere one is at the horizon of n
    assert smooth.mean() > 0.98
    assert np.allclose(found[smooth], slope[smooth], rtol=1e-6, atol=1e-6)


def test_lambertian_points_have_no_gradient_of_roughness_and_metallic() -> None:
    bsdf, view, light = _some_points(400)
    gradient = bsdf.evaluate_vjp(view, light, np.ones((400, 3)))
    dull = np.setdiff1d(np.arange(400), bsdf.glossy)
    assert not gradient.roughness[dull].any()
    assert not gradient.metallic[dull].any()
    assert gradient.normal[dull].any()
