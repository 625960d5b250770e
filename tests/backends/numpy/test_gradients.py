"""The adjoint is the exact derivative of `render`'s picture."""

import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer
from svbrdfgan_numpy.surface import PreparedSurface
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.types import Environment, Materials, View

WRT = frozenset({"base_color", "environment"})
SPP, SEED = 4, 3


def _random(*shape: int, seed: int = 0) -> Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def _corner(max_bounces: int) -> tuple[NumpyRenderer, PreparedSurface, View, list[Tensor]]:
    """A renderer, a scene of textured and constant parts that see one another, and the parts' base colours."""
    renderer, view = NumpyRenderer(max_bounces), scenes.corner_view(scenes.random_light())
    colors = [scenes.random_texture(6, 5), torch.tensor([0.9, 0.5, 0.2]), scenes.random_texture(3, 4, seed=1)]
    return renderer, renderer.prepare(scenes.corner_box()), view, colors


@pytest.mark.parametrize("max_bounces", [1, 3])
def test_base_color_against_finite_differences(max_bounces: int) -> None:
    renderer, prepared, view, colors = _corner(max_bounces)
    cotangent = _random(view.height, view.width, 3)

    def loss(moved: list[Tensor]) -> float:
        image = renderer.render(prepared, scenes.lambertian(*moved), view, spp=SPP, seed=SEED).image
        return float((image.double() * cotangent).sum())

    gradients = renderer.render_vjp(
        prepared, scenes.lambertian(*colors), view, cotangent, wrt=WRT, spp=SPP, seed=SEED
    ).materials
    for part, color in enumerate(colors):
        step = 0.01 * _random(*color.shape, seed=part + 1)
        forward, backward = ([*colors[:part], color + s * step, *colors[part + 1 :]] for s in (1.0, -1.0))
        slope = (gradients[part]["base_color"].double() * step).sum()
        assert gradients[part]["base_color"].shape == color.shape
        assert abs(float(slope)) > 1e-4
        assert (loss(forward) - loss(backward)) / 2.0 == pytest.approx(float(slope), rel=2e-3, abs=1e-6)


@pytest.mark.parametrize("max_bounces", [1, 3])
def test_environment_against_finite_differences(max_bounces: int) -> None:
    """Light is moved between channels: sampling depends on their mean, so the samples stay the same."""
    renderer, prepared, view, colors = _corner(max_bounces)
    cotangent, radiance = _random(view.height, view.width, 3), view.environment.radiance.double() + 0.5
    step = 0.1 * _random(*radiance.shape, seed=5).double()
    step -= step.mean(dim=-1, keepdim=True)
    materials = scenes.lambertian(*colors)

    def loss(light: Tensor) -> float:
        lit = View(view.camera, Environment(light), view.width, view.height)
        image = renderer.render(prepared, materials, lit, spp=SPP, seed=SEED).image
        return float((image.double() * cotangent).sum())

    lit = View(view.camera, Environment(radiance), view.width, view.height)
    gradient = renderer.render_vjp(prepared, materials, lit, cotangent, wrt=WRT, spp=SPP, seed=SEED).environment
    assert gradient is not None
    slope = float((gradient.double() * step).sum())
    assert abs(slope) > 1e-3
    assert (loss(radiance + step) - loss(radiance - step)) / 2.0 == pytest.approx(slope, rel=1e-4, abs=1e-6)
    assert float((gradient.double() * radiance).sum()) == pytest.approx(loss(radiance), rel=1e-4)


def test_an_unseen_part_and_unseen_texels_have_exactly_no_gradient() -> None:
    behind = scenes.quad((-1.0, -1.0, -1.0), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    surface = scenes.joined(scenes.plane(2.0), behind)
    materials = scenes.lambertian(scenes.random_texture(8, 8), scenes.random_texture(4, 4))
    renderer, view = NumpyRenderer(), scenes.front_view(scenes.constant_light(), 1.0, vertical_fov=0.8)
    gradients = renderer.render_vjp(
        renderer.prepare(surface), materials, view, torch.ones(16, 16, 3), wrt=WRT, spp=4, seed=0
    ).materials
    seen = gradients[0]["base_color"][..., 0]
    assert (gradients[1]["base_color"] == 0.0).all()
    assert (seen[[0, -1]] == 0.0).all()
    assert (seen[:, [0, -1]] == 0.0).all()
    assert (seen[2:6, 2:6] > 0.0).all()


def test_only_what_is_asked_for_is_given() -> None:
    renderer, prepared, view, colors = _corner(1)
    materials: Materials = scenes.lambertian(*colors)
    ones = torch.ones(view.height, view.width, 3)
    maps = renderer.render_vjp(prepared, materials, view, ones, wrt=frozenset({"base_color"}), spp=1, seed=0)
    light = renderer.render_vjp(prepared, materials, view, ones, wrt=frozenset({"environment"}), spp=1, seed=0)
    assert maps.environment is None
    assert [set(part) for part in maps.materials] == [{"base_color"}] * 3
    assert [set(part) for part in light.materials] == [set()] * 3
    assert light.environment is not None
    assert light.environment.shape == view.environment.radiance.shape
