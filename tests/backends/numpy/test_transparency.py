"""Rays pass through parts with the probability 1 - alpha."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy import ndarray
from svbrdfgan_numpy import NumpyRenderer
from svbrdfgan_numpy.transparency import RayNumbers

from svbrdfgan.testing import scenes
from svbrdfgan.types import Surface

RENDERER = NumpyRenderer()
WHITE = (1.0, 1.0, 1.0)


def _with_alpha(surface: Surface, *alphas: float | ndarray) -> Surface:
    parts = [replace(part, alpha=alpha) for part, alpha in zip(surface.parts, alphas, strict=True)]
    return replace(surface, parts=tuple(parts))


def test_a_plane_covers_as_much_as_its_alpha() -> None:
    view = scenes.front_view(scenes.constant_light(), vertical_fov=0.2)
    rendering = scenes.picture(RENDERER, _with_alpha(scenes.plane(), 0.3), scenes.lambertian(WHITE), view, spp=64)
    error = np.sqrt(0.3 * 0.7 / (64 * 256))
    assert float(rendering.coverage.mean()) == pytest.approx(0.3, abs=4.5 * error)
    assert torch.allclose(scenes.surface_radiance(rendering), torch.ones(3), rtol=0.02)


def test_at_alpha_0_there_is_nothing_and_at_1_nothing_passes() -> None:
    view = scenes.corner_view(scenes.random_light())
    materials = scenes.lambertian(scenes.random_texture(4, 4), scenes.RED, scenes.GREEN)

    def picture(*alphas: float | ndarray) -> torch.Tensor:
        surface = _with_alpha(scenes.corner_box(), *alphas)
        return scenes.picture(NumpyRenderer(3), surface, materials, view)

    assert not picture(0.0, 0.0, 0.0).coverage.any()
    beside = scenes.joined(scenes.corner_box(), scenes.quad((90.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    far = _with_alpha(beside, 1.0, np.ones((2, 3)), 1.0, 0.5)
    four = scenes.lambertian(scenes.random_texture(4, 4), scenes.RED, scenes.GREEN, WHITE)
    assert torch.allclose(
        scenes.picture(NumpyRenderer(3), far, four, view).image,
        scenes.picture(NumpyRenderer(3), beside, four, view).image,
        rtol=1e-12,
    )


def test_sheets_in_one_place_are_passed_one_by_one() -> None:
    """The far one shows where the near one is passed; of two in the same place either may stop a ray."""
    view = scenes.front_view(scenes.constant_light(), vertical_fov=0.2)
    for gap in (0.3, 0.0):
        behind = scenes.quad((-1.0, -1.0, -gap), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
        both = _with_alpha(scenes.joined(scenes.plane(2.0), behind), 0.4, 0.5)
        coverage = scenes.picture(RENDERER, both, scenes.lambertian(WHITE, WHITE), view, spp=64).coverage
        assert float(coverage.mean()) == pytest.approx(1.0 - 0.6 * 0.5, abs=4.5 * np.sqrt(0.21 / (64 * 256)))


@pytest.mark.parametrize("max_bounces", [1, 2])
def test_light_through_a_sheet_loses_alpha(max_bounces: int) -> None:
    """A plane seen from between itself and a black sheet that hides its whole sky."""
    view = scenes.spot_view((0.0, 0.0, 0.0), (0.05, 0.0, 0.1), scenes.random_light(), extent=0.01)
    view = replace(view, camera=replace(view.camera, origin=tuple(np.array([0.3, 0.0, 0.6]) * 0.1)))
    sheet = scenes.quad((-100.0, -100.0, 0.1), (200.0, 0.0, 0.0), (0.0, 200.0, 0.0))
    materials = scenes.lambertian(WHITE, (0.0, 0.0, 0.0))
    clear, dim = (
        scenes.picture(
            NumpyRenderer(max_bounces),
            _with_alpha(scenes.joined(scenes.plane(), sheet), 1.0, alpha),
            materials,
            view,
            spp=256,
        ).image
        for alpha in (0.0, 0.35)
    )
    assert (clear > 0.0).all()
    assert float(dim.mean() / clear.mean()) == pytest.approx(0.65, rel=0.02)


def test_furnace_white_walls_that_light_passes_cannot_be_seen() -> None:
    view = scenes.corner_view(scenes.constant_light())
    walls = _with_alpha(scenes.corner_box(), 0.5, np.array([[0.2, 0.9], [0.4, 1.0]]), 0.8)
    rendering = scenes.picture(NumpyRenderer(max_bounces=32), walls, scenes.lambertian(*3 * [WHITE]), view, spp=64)
    assert torch.allclose(scenes.surface_radiance(rendering), torch.ones(3), rtol=0.01)
    assert float(rendering.coverage.max()) > float(rendering.coverage.mean())


def test_an_alpha_texture_lies_as_a_base_colour_does() -> None:
    """What is only there at the texel of u = 1, v = 1 is seen at the top right."""
    view = scenes.front_view(scenes.constant_light(), 2.0, 8, 8, 2.0 * np.arctan(0.25))
    alpha = np.zeros((2, 2))
    alpha[1, 1] = 1.0
    coverage = scenes.picture(
        RENDERER, _with_alpha(scenes.plane(), alpha), scenes.lambertian(WHITE), view, spp=64
    ).coverage
    assert float(coverage[:2, -2:].mean()) > 0.9
    assert not coverage[:2, :2].any()
    assert not coverage[-2:].any()


def test_the_gradient_is_of_the_same_picture_and_the_transport_its_samples() -> None:
    surface, view = _with_alpha(scenes.corner_box(), 0.6, 0.3, 1.0), scenes.corner_view(scenes.random_light())
    colors = [scenes.random_texture(6, 5), torch.tensor([0.9, 0.5, 0.2]), scenes.random_texture(3, 4, seed=1)]
    materials, prepared = scenes.lambertian(*colors), RENDERER.prepare(surface)
    truth = RENDERER.render(prepared, materials, view, spp=8, seed=5)
    cotangent = torch.randn(12, 12, 3, generator=torch.Generator().manual_seed(0))
    wrt = frozenset({"base_color"})
    gradients = RENDERER.render_vjp(prepared, materials, view, cotangent, wrt=wrt, spp=8, seed=5).materials
    by_gradient = sum((g["base_color"] * color).sum() for g, color in zip(gradients, colors, strict=True))
    assert float(by_gradient) == pytest.approx(float((truth.image * cotangent).sum()), rel=1e-4)

    white = RENDERER.render(prepared, scenes.lambertian(*3 * [WHITE]), view, spp=8, seed=5).image
    samples = list(RENDERER.transport(prepared, view, spp=8, seed=5))
    pixel, weight = (torch.cat([getattr(chunk, name) for chunk in samples]) for name in ("pixel", "weight"))
    found = torch.zeros(144, 3).index_add(0, pixel, weight).reshape(12, 12, 3)
    assert torch.allclose(found, white, atol=1e-6)
    assert torch.allclose(pixel.bincount(minlength=144).reshape(12, 12) / 8.0, truth.coverage)


def test_the_same_seed_gives_the_same_picture_however_it_is_cut() -> None:
    surface = _with_alpha(scenes.corner_box(), 0.6, 0.3, 0.9)
    view = scenes.corner_view(scenes.random_light(), width=5, height=4)
    materials = scenes.lambertian(scenes.random_texture(4, 4), scenes.RED, scenes.GREEN)
    images = [
        scenes.picture(NumpyRenderer(3, chunk), surface, materials, view, spp=3, seed=seed).image
        for chunk, seed in ((100_000, 8), (100, 8), (1, 8), (1, 9))
    ]
    assert torch.equal(images[0], images[1])
    assert torch.equal(images[0], images[2])
    assert not torch.equal(images[0], images[3])


def test_the_numbers_are_uniform_and_those_of_neighbours_independent() -> None:
    """Rays that differ in seed, stage, path or face alone."""
    count = 40_000
    ray, face = np.arange(count), np.zeros(count, dtype=np.int64)
    draws = [
        RayNumbers(7, 2, ray).draw(ray, face),
        RayNumbers(8, 2, ray).draw(ray, face),
        RayNumbers(-7, 2, ray).draw(ray, face),
        RayNumbers(7, 3, ray).draw(ray, face),
        RayNumbers(7, 2, ray + 1).draw(ray, face),
        RayNumbers(7, 2, ray).draw(ray, face + 1),
        RayNumbers(7, 2, np.zeros(count, dtype=np.int64)).draw(ray, ray),
    ]
    for draw in draws:
        found = np.histogram(draw, 50, (0.0, 1.0))[0]
        assert ((found - count / 50) ** 2 / (count / 50)).sum() < 49 + 5.0 * np.sqrt(2.0 * 49)
    assert np.abs(np.corrcoef(draws) - np.eye(len(draws))).max() < 5.0 / np.sqrt(count)
