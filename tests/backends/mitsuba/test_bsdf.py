"""The material at single points against its formula in float64, and the directions drawn against their density."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray
from svbrdfgan_mitsuba import MitsubaRenderer, variant
from svbrdfgan_mitsuba.bsdf import EVEN, GLOSS, Bsdf, Lambertian, MetallicRoughness
from svbrdfgan_mitsuba.interop import dr
from svbrdfgan_mitsuba.normal_map import tilted_normal

COLOR = np.array([0.9, 0.5, 0.1])
Vectors = Float[ndarray, "n 3"]


@dataclass(frozen=True)
class Point:
    """A point that reflects, seen from one direction."""

    roughness: float
    metallic: float
    normal: Float[ndarray, 3]
    viewer: Float[ndarray, 3]

    def value(self, incoming: Vectors) -> Vectors:
        """The BSDF times the cosine, by docs/conventions.md."""
        d, visible = self.facets(incoming)
        cosine = np.maximum(incoming @ self.normal, 0.0)
        p = (1.0 - self._half(incoming) @ self.viewer) ** 5
        lobe = d * visible(self.normal @ self.viewer) * visible(cosine) / 4.0 * cosine
        fresnel = 0.04 + 0.96 * p
        dielectric = ((1.0 - fresnel) * cosine / np.pi)[:, None] * COLOR + (fresnel * lobe)[:, None]
        metal = (COLOR + (1.0 - COLOR) * p[:, None]) * lobe[:, None]
        return (1.0 - self.metallic) * dielectric + self.metallic * metal

    def mirrored_density(self, incoming: Vectors) -> Float[ndarray, " n"]:
        """Of the gloss by visible facets."""
        d, visible = self.facets(incoming)
        return d * visible(self.normal @ self.viewer) / 4.0

    def facets(self, incoming: Vectors) -> tuple[Float[ndarray, " n"], Any]:
        alpha = max(self.roughness, 0.05) ** 2
        cosine = self._half(incoming) @ self.normal
        d = np.where(cosine > 0.0, alpha**2 / (np.pi * (cosine**2 * (alpha**2 - 1.0) + 1.0) ** 2), 0.0)
        return d, lambda x: 2.0 / (x + np.sqrt(alpha**2 + (1.0 - alpha**2) * x**2))

    def made(self, mi: Any, *, flat: bool) -> MetallicRoughness:
        """The same in the renderer, with the normal as the z axis if `flat`."""
        normal = None if flat else vector(mi, self.normal)
        color, metallic = mi.Color3f(*COLOR.tolist()), mi.Float(self.metallic)
        return MetallicRoughness(
            mi, color, normal, mi.Float(self.roughness), metallic, mi.Bool(True), vector(mi, self.viewer)
        )

    def _half(self, incoming: Vectors) -> Vectors:
        half = incoming + self.viewer
        return half / np.linalg.norm(half, axis=1, keepdims=True)


def unit(*values: float) -> Float[ndarray, 3]:
    """Of unit length in float64: rounded to float32 it would make the formula's peaks err by 1 %."""
    return np.array(values) / np.linalg.norm(values)


def in_float64(directions: Any) -> Vectors:
    """Drawn directions, of unit length."""
    result = directions.numpy().T.astype(np.float64)
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


def vector(mi: Any, values: ndarray) -> Any:
    """One vector, or many."""
    return mi.Vector3f(*(mi.Float(channel.astype(np.float32)) for channel in np.atleast_2d(values.T).T))


UP, TILTED = unit(0.0, 0.0, 1.0), unit(0.3, -0.2, 0.9)
VIEWERS = (unit(0.0, 0.0, 1.0), unit(0.6, 0.3, 0.7), unit(-0.9, 0.4, 0.05))
POINTS = [
    Point(roughness, metallic, normal, viewer)
    for roughness in (0.0, 0.05, 0.2, 1.0)
    for metallic in (0.0, 0.6, 1.0)
    for normal in (UP, TILTED)
    for viewer in VIEWERS
    if normal @ viewer > 0.0
]


@pytest.fixture(scope="module")
def mi(renderer: MitsubaRenderer) -> Any:
    return variant.load(renderer.device)


def drawn(mi: Any, bsdf: Bsdf, count: int) -> Any:
    """Directions of unit length."""
    random = np.random.default_rng(0).random((3, count), dtype=np.float32)
    return dr.normalize(bsdf.sample(mi.Float(random[0]), mi.Point2f(random[1], random[2])))


@pytest.mark.parametrize("point", POINTS, ids=str)
def test_values_are_those_of_the_formula(mi: Any, point: Point) -> None:
    """Where directions are drawn, with lobes as narrow as they come, float32 errs by 0.1 % of the peak at most."""
    bsdf = point.made(mi, flat=point.normal is UP)
    incoming = drawn(mi, bsdf, 20_000)
    seen, truth = bsdf.value(incoming).numpy().T, point.value(in_float64(incoming))
    assert np.isfinite(seen).all()
    np.testing.assert_allclose(seen, truth, rtol=2e-3, atol=1e-6 + 1e-3 * truth.max())
    assert seen.sum() == pytest.approx(truth.sum(), rel=1e-4)


@pytest.mark.parametrize("point", POINTS, ids=str)
def test_directions_are_drawn_by_their_density(mi: Any, point: Point) -> None:
    """The densities of both lobes, in float64, over that of the mixture have a mean of one."""
    bsdf = point.made(mi, flat=point.normal is UP)
    incoming, count = drawn(mi, bsdf, 400_000), 400_000
    density, directions = bsdf.density(incoming).numpy().astype(np.float64), in_float64(incoming)
    share = GLOSS[0] + (GLOSS[1] - GLOSS[0]) * point.metallic
    mirrored, diffuse = point.mirrored_density(directions), np.maximum(directions @ point.normal, 0.0) / np.pi
    if point.normal is not UP:
        diffuse = (1.0 - EVEN) * diffuse + EVEN * (diffuse > 0.0) / (2.0 * np.pi)
    np.testing.assert_allclose(
        density, share * mirrored + (1.0 - share) * diffuse, rtol=5e-3, atol=1e-3 * density.max()
    )
    for lobe in (mirrored, diffuse):
        ratio = np.divide(lobe, density, out=np.zeros(count), where=density > 0.0)
        assert ratio.max() < 4.1  # the least share of a lobe is a quarter
        assert ratio.mean() == pytest.approx(1.0, abs=4.5 * ratio.std() / np.sqrt(count) + 1e-4)
        assert ratio.std() / np.sqrt(count) < 3e-3


@pytest.mark.parametrize("glossy", [False, True])
def test_the_slope_in_a_normal_has_bounded_weights(mi: Any, glossy: bool) -> None:
    """At the horizon of n the cosine vanishes, and so would a density by it alone, but not the slope."""
    normal, viewer = vector(mi, TILTED), vector(mi, VIEWERS[1])
    made = (
        MetallicRoughness(mi, mi.Color3f(0.5), normal, mi.Float(0.4), mi.Float(0.5), mi.Bool(True), viewer)
        if glossy
        else Lambertian(mi, mi.Color3f(0.5), normal)
    )
    incoming = drawn(mi, made, 1_000_000)
    cosines, density = dr.dot(normal, incoming).numpy(), made.density(incoming).numpy()
    assert cosines.min() < 1e-4
    assert density[cosines > 0.0].min() > 0.25 * EVEN / (2.0 * np.pi)


def test_without_roughness_a_part_is_lambertian(mi: Any) -> None:
    """In a kernel with gloss, normal map and metallic, it reflects as in the kernel without."""
    viewer, normal = vector(mi, VIEWERS[1]), vector(mi, TILTED)
    full = MetallicRoughness(mi, mi.Color3f(0.5), normal, mi.Float(1.0), mi.Float(0.0), mi.Bool(False), viewer)
    plain = Lambertian(mi, mi.Color3f(0.5), normal)
    incoming = drawn(mi, full, 1000)
    np.testing.assert_array_equal(incoming.numpy(), drawn(mi, plain, 1000).numpy())
    np.testing.assert_array_equal(full.value(incoming).numpy(), plain.value(incoming).numpy())
    np.testing.assert_allclose(full.density(incoming).numpy(), plain.density(incoming).numpy())


@pytest.mark.parametrize("viewer", [unit(1.0, 0.0, 0.0), unit(1.0, 0.0, 1e-6), unit(0.5, -0.5, 1e-3)])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_all_is_finite_at_grazing_view(mi: Any, roughness: float, viewer: Float[ndarray, 3]) -> None:
    bsdf = Point(roughness, 0.5, UP, viewer).made(mi, flat=True)
    incoming = drawn(mi, bsdf, 1000)
    for values in (incoming, bsdf.value(incoming), bsdf.density(incoming)):
        assert np.isfinite(values.numpy()).all()


def test_a_normal_that_is_turned_away_shows_no_facets(mi: Any) -> None:
    """Only maps with z < 0 can make one; directions are then drawn diffusely, and everything is finite."""
    bsdf = Point(0.1, 1.0, unit(-0.5, 0.0, -0.8), VIEWERS[1]).made(mi, flat=False)
    incoming = drawn(mi, bsdf, 1000)
    cosines = incoming.numpy().T @ unit(-0.5, 0.0, -0.8)
    diffuse = (1.0 - EVEN) * cosines / np.pi + EVEN / (2.0 * np.pi)
    np.testing.assert_allclose(bsdf.density(incoming).numpy(), diffuse, rtol=1e-4, atol=1e-6)
    assert np.isfinite(bsdf.value(incoming).numpy()).all()


def bent(normal: Float[ndarray, 3], viewer: Float[ndarray, 3]) -> Float[ndarray, 3]:
    """By bisection: the least k at which the mirror direction about n + k w_o is not below the surface."""

    def moved(k: float) -> Float[ndarray, 3]:
        result: Float[ndarray, 3] = normal + k * viewer
        return result / np.linalg.norm(result)

    def below(k: float) -> bool:
        n = moved(k)
        return bool((2.0 * (n @ viewer) * n - viewer)[2] < 0.0)

    if not below(0.0):
        return moved(0.0)
    low, high = 0.0, 1e4
    for _ in range(200):
        middle = (low + high) / 2.0
        low, high = (middle, high) if below(middle) else (low, middle)
    return moved(high)


@pytest.mark.parametrize("behind", [False, True])
def test_normals_are_scaled_turned_and_bent(mi: Any, behind: bool) -> None:
    random = np.random.default_rng(1)
    texel, viewer = random.normal(size=(500, 3)), random.normal(size=(500, 3))
    texel[:, 2], viewer[:, 2] = abs(texel[:, 2]), abs(viewer[:, 2])
    texel[::3, 2] *= -0.3
    viewer /= np.linalg.norm(viewer, axis=1, keepdims=True)
    side = np.array([-1.0, -1.0, 1.0]) if behind else np.ones(3)  # along tangent and bitangent it is turned, too
    wanted = np.stack([bent(side * t / np.linalg.norm(t), w) for t, w in zip(texel, viewer, strict=True)])
    seen = tilted_normal(mi, vector(mi, texel.T), mi.Bool(True), mi.Bool(behind), vector(mi, viewer.T)).numpy().T
    np.testing.assert_allclose(seen, wanted, atol=2e-5)
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), 1.0, atol=1e-6)
    assert (abs(wanted - side * texel / np.linalg.norm(texel, axis=1, keepdims=True)) > 0.01).any(axis=1).mean() > 0.2


@pytest.mark.parametrize(
    ("texel", "given"), [((0.6, 0.0, 0.8), False), ((0.0, 0.0, 0.0), True), ((0.0, 0.0, 0.7), True)]
)
def test_normals_that_change_nothing_change_nothing(mi: Any, texel: tuple[float, ...], given: bool) -> None:
    """No map, one of no length, and one along N."""
    seen = tilted_normal(mi, mi.Vector3f(*texel), mi.Bool(given), mi.Bool(True), mi.Vector3f(0.8, 0.0, 0.6))
    np.testing.assert_array_equal(seen.numpy().ravel(), [0.0, 0.0, 1.0])


def test_the_slope_of_bent_normals_is_that_of_finite_differences(mi: Any) -> None:
    """Also at the places where it starts to bend, and where nothing is known of a direction."""
    random = np.random.default_rng(2)
    texel, viewer = random.normal(size=(3, 200)), random.normal(size=(3, 200))
    texel[2], viewer[2] = abs(texel[2]) + 0.1, abs(viewer[2]) + 0.02
    viewer /= np.linalg.norm(viewer, axis=0)
    direction, weight = random.normal(size=(3, 200)), random.normal(size=(3, 200))

    def loss(step: float) -> Float[ndarray, " n"]:
        moved = texel + step * direction
        n = np.stack([bent(t / np.linalg.norm(t), w) for t, w in zip(moved.T, viewer.T, strict=True)])
        return (n.T * weight).sum(axis=0)

    leaf = vector(mi, texel)
    dr.enable_grad(leaf)
    seen = tilted_normal(mi, leaf, mi.Bool(True), mi.Bool(False), vector(mi, viewer))
    dr.backward(dr.sum(dr.dot(seen, vector(mi, weight))))
    slope = (dr.grad(leaf).numpy() * direction).sum(axis=0)
    truth = (loss(1e-4) - loss(-1e-4)) / 2e-4
    np.testing.assert_allclose(slope, truth, rtol=2e-3, atol=2e-3 * abs(truth).max())

    nothing = vector(mi, np.array([[0.0, 1.0], [0.0, 0.0], [0.0, 2.0]]))  # beside a map that has a direction
    dr.enable_grad(nothing)
    seen = tilted_normal(mi, nothing, mi.Bool(True), mi.Bool(False), mi.Vector3f(0.0, 0.0, 1.0))
    dr.backward(dr.sum(seen.x))
    np.testing.assert_allclose(dr.grad(nothing).numpy().T, [[0.0, 0.0, 0.0], [4 / 5**1.5, 0.0, -2 / 5**1.5]], atol=1e-6)
