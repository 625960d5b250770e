"""Rays pass through parts that are not opaque: from the camera, to the light, and on paths."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch
from jaxtyping import Float
from numpy import ndarray
from svbrdfgan_mitsuba import MitsubaRenderer, rays

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Surface, View

VIEW = View(Camera((1.5, 1.2, 3.0)), scenes.random_light(rotation=0.7), 12, 9)
FLOOR = scenes.random_texture(5, 7)
COLORS = scenes.lambertian(FLOOR, scenes.GREEN)
WHITE = scenes.lambertian((1.0, 1.0, 1.0))


def with_alpha(surface: Surface, *alpha: float | Float[ndarray, "rows cols"]) -> Surface:
    parts = zip(surface.parts, alpha, strict=True)
    return dataclasses.replace(surface, parts=tuple(dataclasses.replace(part, alpha=value) for part, value in parts))


def stack_of_squares(count: int, alpha: float) -> Surface:
    """Squares before one another, 1 mm apart, that face +Z."""
    quads = (scenes.quad((-1.0, -1.0, -0.001 * i), (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)) for i in range(count))
    return with_alpha(scenes.joined(*quads), *[alpha] * count)


@pytest.mark.parametrize("max_bounces", [1, 3])
@pytest.mark.parametrize("alpha", [0.0, np.zeros((2, 3))], ids=["constant", "texture"])
def test_what_is_transparent_is_as_if_it_were_not_there(
    max_bounces: int, alpha: float | Float[ndarray, "rows cols"]
) -> None:
    """From the same seed: neither seen, nor in the light's way, nor in that of paths."""
    renderer = MitsubaRenderer("cpu", max_bounces)
    passed = scenes.picture(renderer, with_alpha(scenes.occluder(), 1.0, alpha), COLORS, VIEW, spp=16)
    alone = scenes.picture(renderer, scenes.floor(), scenes.lambertian(FLOOR), VIEW, spp=16)
    opaque = scenes.picture(renderer, scenes.occluder(), COLORS, VIEW, spp=16)
    torch.testing.assert_close(passed.image, alone.image, rtol=1e-3, atol=1e-4)
    assert torch.equal(passed.coverage, alone.coverage)
    assert float((opaque.image - alone.image).abs().mean()) > 0.05 * float(alone.image.mean())


def test_what_is_nearly_opaque_is_as_if_it_were(renderer: MitsubaRenderer) -> None:
    """The loop of rays that may pass finds the same hits as the single ray of an opaque scene."""
    nearly = with_alpha(scenes.occluder(), 1.0, np.nextafter(1.0, 0.0))
    a, b = (scenes.picture(renderer, surface, COLORS, VIEW, spp=16) for surface in (nearly, scenes.occluder()))
    assert torch.equal(a.image, b.image)
    assert torch.equal(a.coverage, b.coverage)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_coverage_is_what_all_sheets_stop(renderer: MitsubaRenderer, count: int) -> None:
    view = scenes.front_view(scenes.constant_light(), vertical_fov=0.2, width=16, height=16)
    coverage = scenes.picture(
        renderer, stack_of_squares(count, 0.3), scenes.lambertian(*[scenes.RED] * count), view, spp=1024
    ).coverage
    deviation = 0.5 / (256 * 1024) ** 0.5
    assert float(coverage.mean()) == pytest.approx(1.0 - 0.7**count, abs=4.5 * deviation)


def test_light_passes_by_one_less_alpha(renderer: MitsubaRenderer) -> None:
    """Of a sun behind the camera's sheet; the floor below sees it through a lid of alpha 0.25."""
    camera = Camera((0.5, 0.25, 2.0), (0.5, 0.0, 0.0), vertical_fov=0.05)
    view = View(camera, scenes.sun(1, 0, rows=180, cols=4), 8, 8)
    plain = scenes.picture(renderer, scenes.floor(), WHITE, view, spp=64).image.mean()
    lid = with_alpha(scenes.occluder(), 1.0, 0.25)
    dimmed = scenes.picture(renderer, lid, scenes.lambertian((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)), view, spp=4096).image
    assert float(dimmed.mean() / plain) == pytest.approx(0.75, rel=0.02)


def test_alpha_lies_as_textures_and_repeats_as_they_do(renderer: MitsubaRenderer) -> None:
    """Texel (row, col) at u = (col + 0.5) / cols, v = (row + 0.5) / rows: the lower right is opaque."""
    alpha = np.zeros((2, 2))
    alpha[0, 1] = 1.0
    view = scenes.front_view(scenes.constant_light(), distance=20.0, vertical_fov=0.1, width=8, height=8)
    square = scenes.plane(2.0)
    seen = scenes.picture(renderer, with_alpha(square, alpha), WHITE, view, spp=1024).coverage
    truth = np.outer(np.clip(1.5 - (np.arange(8) + 0.5)[::-1] / 4, 0, 1), np.clip((np.arange(8) + 0.5) / 4 - 0.5, 0, 1))
    np.testing.assert_allclose(seen.numpy(), truth, atol=0.07)
    twice = scenes.surface_of(square.positions, square.normals, 2.0 * square.uv, square.faces, repeat=(True, True))
    tiled = scenes.picture(renderer, with_alpha(twice, alpha), WHITE, view, spp=1024).coverage
    torch.testing.assert_close(tiled[:4, :4], tiled[4:, 4:], rtol=0.0, atol=0.1)
    assert float(tiled.mean()) == pytest.approx(0.25, abs=0.02)


@pytest.mark.parametrize(("count", "coverage"), [(rays.POINTS - 1, 0.0), (rays.POINTS, 1.0)])
def test_a_ray_passes_a_bounded_number_of_points(renderer: MitsubaRenderer, count: int, coverage: float) -> None:
    view = scenes.front_view(scenes.constant_light(), vertical_fov=0.2, width=4, height=4)
    materials = scenes.lambertian(*[scenes.RED] * count)
    seen = scenes.picture(renderer, stack_of_squares(count, 0.0), materials, view, spp=4)
    assert (seen.coverage == coverage).all()


def test_transport_passes_as_the_picture_does(renderer: MitsubaRenderer) -> None:
    prepared = renderer.prepare(with_alpha(scenes.occluder(), 1.0, 0.4))
    materials = scenes.lambertian(scenes.RED, scenes.GREEN)
    rendering = renderer.render(prepared, materials, VIEW, spp=8, seed=3)
    (samples,) = renderer.transport(prepared, VIEW, spp=8, seed=3)
    color = torch.stack([material.base_color for material in materials.parts])[samples.part]
    image = torch.zeros(VIEW.height * VIEW.width, 3).index_add(0, samples.pixel, samples.weight * color)
    torch.testing.assert_close(image.view_as(rendering.image), rendering.image, rtol=1e-4, atol=1e-6)
    counted = torch.bincount(samples.pixel, minlength=VIEW.height * VIEW.width) / 8
    assert torch.equal(counted.view_as(rendering.coverage), rendering.coverage)
    assert not torch.equal(
        rendering.coverage, scenes.picture(renderer, scenes.occluder(), materials, VIEW, 8, 3).coverage
    )


@pytest.mark.parametrize("max_bounces", [1, 3])
def test_gradients_pass_as_the_picture_does(max_bounces: int) -> None:
    """Both draw the same, so the base colour's gradient is that of the very picture."""
    renderer = MitsubaRenderer("cpu", max_bounces)
    prepared = renderer.prepare(with_alpha(scenes.occluder(), 0.7, np.linspace(0.1, 0.9, 12).reshape(3, 4)))

    def loss(step: float) -> float:
        materials = scenes.lambertian(FLOOR, (0.1 + step, 0.8, 0.1))
        return float(renderer.render(prepared, materials, VIEW, spp=8, seed=2).image.double().sum())

    ones, base = torch.ones(VIEW.height, VIEW.width, 3), frozenset({"base_color"})
    gradients = renderer.render_vjp(prepared, COLORS, VIEW, ones, wrt=base, spp=8, seed=2)
    slope = (loss(0.1) - loss(-0.1)) / 0.2
    assert float(gradients.materials[1]["base_color"][0]) == pytest.approx(slope, rel=5e-3)
    assert slope > 1.0
