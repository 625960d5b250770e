"""The gradient with respect to the environment: the picture is linear in its light."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from svbrdfgan_warp import WarpRenderer
from torch import Tensor

from svbrdfgan.protocols import Renderer
from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Environment, Materials, Surface, View

LIGHT, BOTH = frozenset({"environment"}), frozenset({"base_color", "environment"})
ROTATION = 0.7


@dataclass(frozen=True)
class Case:
    """A scene, and a gradient of its picture."""

    surface: Surface
    materials: Materials
    view: View

    @property
    def grad_image(self) -> Tensor:
        """A gradient of both signs, with a mean that is significant."""
        shape = (self.view.height, self.view.width, 3)
        return 1.0 + torch.randn(shape, generator=torch.Generator().manual_seed(1))

    def under(self, radiance: Tensor) -> Case:
        environment = Environment(radiance, self.view.environment.rotation)
        return Case(
            self.surface, self.materials, View(self.view.camera, environment, self.view.width, self.view.height)
        )

    def loss(self, renderer: Renderer, *, spp: int, seed: int) -> float:
        """sum(image * grad_image)."""
        image = renderer.render(renderer.prepare(self.surface), self.materials, self.view, spp=spp, seed=seed).image
        return float((image.double() * self.grad_image).sum())

    def gradient(self, renderer: Renderer, *, spp: int, seed: int) -> Tensor:
        args = (renderer.prepare(self.surface), self.materials, self.view, self.grad_image)
        gradient = renderer.render_vjp(*args, wrt=LIGHT, spp=spp, seed=seed).environment
        assert gradient is not None
        return gradient.double()


def shadowed(environment: Environment) -> Case:
    """The lid and its shadow, with one part textured."""
    materials = scenes.lambertian(scenes.random_texture(5, 7), scenes.GREEN)
    return Case(scenes.occluder(), materials, View(Camera((1.5, 1.2, 3.0)), environment, 12, 9))


def mean_and_error(values: list[Tensor]) -> tuple[Tensor, Tensor]:
    """The mean, and its standard error."""
    stack = torch.stack(values).double()
    return stack.mean(dim=0), stack.std(dim=0) / math.sqrt(len(values))


def blocks(gradients: list[Tensor]) -> tuple[Tensor, Tensor]:
    """Mean and standard error of the sums over 2 rows, 4 columns and the channels."""
    return mean_and_error([gradient.view(4, 2, 4, 4, 3).sum(dim=(1, 3, 4)) for gradient in gradients])


def share_of_irradiance(normal: np.ndarray, rows: int, cols: int, rotation: float, fine: int = 32) -> np.ndarray:
    """Each pixel's share of irradiance / pi on an unshadowed surface, by the midpoint rule."""
    y, x = ((np.arange(n * fine) + 0.5) / fine for n in (rows, cols))
    polar, azimuth = np.pi * y[:, None] / rows, 2.0 * np.pi * (x / cols - 0.5) - rotation
    direction = [np.sin(polar) * np.sin(azimuth), np.cos(polar) + 0.0 * azimuth, -np.sin(polar) * np.cos(azimuth)]
    cosine = np.maximum(np.tensordot(normal, np.stack(direction), axes=1), 0.0)
    flux = cosine / np.pi * np.sin(polar) * 2.0 * np.pi**2 / (rows * cols * fine**2)
    apart = np.abs((x - np.arange(cols)[:, None] - 0.5 + cols / 2) % cols - cols / 2)
    across = np.maximum(1.0 - apart, 0.0)
    down = np.maximum(1.0 - np.abs(np.clip(y, 0.5, rows - 0.5) - np.arange(rows)[:, None] - 0.5), 0.0)
    return np.asarray(down @ flux @ across.T)


@pytest.mark.parametrize(("rows", "cols"), [(8, 16), (7, 9), (1, 1), (1, 5), (3, 1), (2, 2)])
def test_the_picture_is_the_product_of_light_and_gradient(renderer: WarpRenderer, rows: int, cols: int) -> None:
    case = shadowed(scenes.random_light(rows, cols, rotation=ROTATION))
    gradient = case.gradient(renderer, spp=8, seed=5)
    assert gradient.shape == (rows, cols, 3)
    through = float((gradient * case.view.environment.radiance).sum())
    assert through == pytest.approx(case.loss(renderer, spp=8, seed=5), rel=1e-5)


def test_the_gradient_is_that_of_finite_differences_on_the_same_directions(renderer: WarpRenderer) -> None:
    """Directions are drawn by the mean of the channels, which steps of multiples of 1/256 leave exactly as it is."""
    generator = torch.Generator().manual_seed(2)
    radiance = torch.randint(64, 192, (6, 12, 3), generator=generator) / 256
    step = torch.randint(0, 64, (6, 12), generator=generator) / 256
    step = torch.stack([step, -step, torch.zeros_like(step)], dim=-1)
    case = shadowed(Environment(radiance, ROTATION))
    slope = float((case.gradient(renderer, spp=4, seed=3) * step).sum())
    higher, lower = (case.under(radiance + s * step).loss(renderer, spp=4, seed=3) for s in (1.0, -1.0))
    assert abs(slope) > 0.1
    assert (higher - lower) / 2 == pytest.approx(slope, rel=1e-4)


def test_on_average_the_gradient_is_that_of_finite_differences(renderer: WarpRenderer) -> None:
    """A long step moves the samples too. The expectation is linear, so it does not show there."""
    case = shadowed(scenes.random_light(rotation=ROTATION))
    radiance = case.view.environment.radiance
    step = radiance * torch.linspace(0.0, 1.0, 16)[:, None]
    slopes, differences = [], []
    for seed in range(0, 96, 3):
        slopes.append((case.gradient(renderer, spp=16, seed=seed) * step).sum())
        higher = case.under(radiance + step).loss(renderer, spp=16, seed=seed + 1)
        lower = case.under(radiance - step).loss(renderer, spp=16, seed=seed + 2)
        differences.append(torch.tensor((higher - lower) / 2))
    (slope, slope_error), (difference, difference_error) = mean_and_error(slopes), mean_and_error(differences)
    error = float(torch.hypot(slope_error, difference_error))
    assert error < 0.02 * abs(float(difference))
    assert abs(float(slope - difference)) < 4 * error


@pytest.mark.parametrize(
    "environment",
    [
        scenes.random_light(6, 10, rotation=ROTATION),
        scenes.constant_light(0.0, 6, 10),
        scenes.sun(2, 0, 6, 10, rotation=-ROTATION),
        scenes.constant_light(1.0, 3, 5),
    ],
    ids=["random", "black", "sun", "odd"],
)
def test_each_pixel_of_the_environment_has_its_known_gradient(renderer: WarpRenderer, environment: Environment) -> None:
    """On a single plane it is the pixel's solid angle times the cosine, independent of the radiance."""
    rows, cols, _ = environment.radiance.shape
    albedo = torch.tensor([0.2, 0.5, 0.9])
    view = View(Camera((0.0, 0.3, 3.0), vertical_fov=0.3), environment, 8, 8)
    surface = scenes.quad((-9.0, -9.0, 0.0), (18.0, 0.0, 0.0), (0.0, 18.0, 0.0))  # fills the film, and faces +Z
    prepared, ones = renderer.prepare(surface), torch.ones(8, 8, 3)
    gradients = [
        renderer.render_vjp(prepared, scenes.lambertian(albedo), view, ones, wrt=LIGHT, spp=16, seed=seed).environment
        for seed in range(32)
    ]
    share = share_of_irradiance(np.array([0.0, 0.0, 1.0]), rows, cols, environment.rotation)
    assert share.sum() == pytest.approx(1.0, rel=1e-3)
    mean, error = mean_and_error([gradient.sum(dim=2) / (64 * albedo.sum()) for gradient in gradients])
    assert (error < 0.01).all()
    assert ((mean - torch.from_numpy(share)).abs() <= 4 * error + 1e-3 * share.max()).all()
    assert torch.allclose(gradients[0] / albedo, (gradients[0] / albedo).mean(dim=2, keepdim=True), rtol=1e-5)


def test_light_from_below_the_horizon_has_exactly_no_gradient(renderer: WarpRenderer) -> None:
    """Row 4 of 8 begins at the horizon; by bilinear lookup it also counts half a row above."""
    view = View(Camera((0.0, 2.0, 1.0)), scenes.random_light(8, 16), 8, 8)
    prepared, materials = renderer.prepare(scenes.floor()), scenes.lambertian((0.5, 0.5, 0.5))
    gradient = renderer.render_vjp(
        prepared, materials, view, torch.ones(8, 8, 3), wrt=LIGHT, spp=64, seed=0
    ).environment
    assert gradient is not None
    assert (gradient[5:] == 0.0).all()
    assert (gradient[:5] > 0.0).all()


def test_light_that_a_lid_keeps_off_has_exactly_no_gradient(renderer: WarpRenderer) -> None:
    """The lid hides the sky from the middle of the floor down to 66 degrees from the zenith, row 5.8 of 16."""
    lid = scenes.quad((-1.0, 0.4, 1.0), (2.0, 0.0, 0.0), (0.0, 0.0, -2.0))
    view = View(Camera((0.0, 0.3, 0.3), vertical_fov=0.3), scenes.random_light(16, 16), 8, 8)
    prepared = renderer.prepare(scenes.joined(scenes.floor(), lid))
    materials = scenes.lambertian((0.5, 0.5, 0.5), (0.0, 0.0, 0.0))
    gradient = renderer.render_vjp(
        prepared, materials, view, torch.ones(8, 8, 3), wrt=LIGHT, spp=64, seed=0
    ).environment
    assert gradient is not None
    assert (gradient[:5] == 0.0).all()
    assert (gradient[6:8] > 0.0).all()


@pytest.mark.parametrize("name", ["shadow", "corner"])
def test_it_agrees_with_the_reference(renderer: WarpRenderer, name: str) -> None:
    reference = pytest.importorskip("svbrdfgan_numpy").NumpyRenderer()
    light = scenes.random_light(8, 16, rotation=ROTATION)
    corner = scenes.lambertian(scenes.RED, scenes.GREEN, (1.0, 1.0, 1.0))
    case = shadowed(light) if name == "shadow" else Case(scenes.corner_box(), corner, scenes.corner_view(light, 9, 9))
    truth, truth_error = blocks([case.gradient(reference, spp=8, seed=seed) for seed in range(24)])
    seen, error = blocks([case.gradient(renderer, spp=64, seed=seed) for seed in range(24)])
    total = torch.hypot(error, truth_error)
    assert ((seen - truth).abs() <= 4 * total).all()
    assert float(total.max()) < 0.05 * float(truth.abs().max())


def test_only_what_is_asked_for_is_given_and_both_are_one_trace(renderer: WarpRenderer) -> None:
    case = shadowed(scenes.random_light(rotation=ROTATION))
    args = (renderer.prepare(case.surface), case.materials, case.view, case.grad_image)
    maps, light, both = (renderer.render_vjp(*args, wrt=w, spp=4, seed=1) for w in (BOTH - LIGHT, LIGHT, BOTH))
    assert maps.environment is None
    assert light.materials == ({}, {})
    assert light.environment is not None
    assert both.environment is not None
    assert torch.allclose(light.environment, both.environment, rtol=1e-6)
    for one, other in zip(maps.materials, both.materials, strict=True):
        assert torch.allclose(one["base_color"], other["base_color"], rtol=1e-6)


def test_light_of_any_kind_of_tensor_is_only_read(renderer: WarpRenderer) -> None:
    """For example a tensor that is float64, not contiguous, and requires a gradient."""
    plain = scenes.random_light(8, 16).radiance
    given = plain.double().transpose(0, 1).contiguous().transpose(0, 1).requires_grad_()
    case = shadowed(Environment(plain, ROTATION))
    a, b = (case.under(radiance).gradient(renderer, spp=2, seed=0) for radiance in (plain, given))
    assert torch.allclose(a, b, rtol=1e-6)
    assert not b.requires_grad
    assert given.grad is None
