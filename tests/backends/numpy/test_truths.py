"""Pictures whose answer is known beforehand."""

import math

import numpy as np
import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Environment, View

GREY = (0.6, 0.3, 0.9)
DIRECT = NumpyRenderer()


def test_furnace_a_plane_in_uniform_light_has_its_base_colour() -> None:
    view = scenes.front_view(scenes.constant_light(2.0))
    rendering = scenes.picture(DIRECT, scenes.plane(), scenes.lambertian(GREY), view, spp=64)
    assert torch.allclose(scenes.surface_radiance(rendering), 2.0 * torch.tensor(GREY), rtol=0.01)


def test_furnace_a_sphere_in_uniform_light_has_its_base_colour() -> None:
    view = scenes.front_view(scenes.constant_light(), width=12, height=12)
    rendering = scenes.picture(DIRECT, scenes.sphere(rows=32, cols=64), scenes.lambertian(GREY), view, spp=64)
    assert torch.allclose(scenes.surface_radiance(rendering), torch.tensor(GREY), rtol=0.01)


def test_furnace_white_walls_in_uniform_light_cannot_be_seen() -> None:
    view = scenes.corner_view(scenes.constant_light())
    white = scenes.lambertian(*3 * [(1.0, 1.0, 1.0)])
    rendering = scenes.picture(NumpyRenderer(max_bounces=32), scenes.corner_box(), white, view, spp=32)
    direct = scenes.picture(DIRECT, scenes.corner_box(), white, view, spp=32)
    assert torch.allclose(scenes.surface_radiance(rendering), torch.ones(3), rtol=0.01)
    assert (scenes.surface_radiance(direct) < 0.9).all()


@pytest.mark.parametrize("max_bounces", [1, 2, 3, 8])
def test_a_bowl_is_a_geometric_series(max_bounces: int) -> None:
    """From any point of a sphere half of it takes half of the cosine-weighted view: it keeps half of the light."""
    truth = sum(0.8**k * 0.5**k for k in range(1, max_bounces + 1))
    view = View(Camera((0.0, 0.0, 0.0), (0.0, -1.0, 0.2), vertical_fov=1.0), scenes.constant_light(), 8, 8)
    rendering = scenes.picture(
        NumpyRenderer(max_bounces), scenes.bowl(), scenes.lambertian((0.8, 0.8, 0.8)), view, spp=256
    )
    assert (rendering.coverage == 1.0).all()
    assert float(scenes.surface_radiance(rendering).mean()) == pytest.approx(truth, rel=0.03)  # 4 standard deviations


@pytest.mark.parametrize(("row", "col"), [(32, 0), (20, 10), (32, 16), (12, 120)])
def test_a_small_sun_shines_by_the_cosine(row: int, col: int) -> None:
    view = scenes.front_view(scenes.sun(row, col), width=4, height=4, vertical_fov=0.2)
    rendering = scenes.picture(DIRECT, scenes.plane(), scenes.lambertian(GREY), view, spp=32)
    cosine = float(scenes.sun_direction(row, col)[2])
    assert cosine > 0.3
    assert torch.allclose(scenes.surface_radiance(rendering), cosine * torch.tensor(GREY), rtol=0.01)


def test_the_shading_normal_alone_decides_the_cosine() -> None:
    tilted = np.tile([0.6, 0.0, 0.8], (4, 1))
    flat = scenes.plane()
    surface = scenes.surface_of(flat.positions, 3.0 * tilted, flat.uv, flat.faces)
    view = scenes.front_view(scenes.sun(32, 0), width=4, height=4, vertical_fov=0.2)
    rendering = scenes.picture(DIRECT, surface, scenes.lambertian((1.0, 1.0, 1.0)), view, spp=32)
    cosine = float(scenes.sun_direction(32, 0) @ tilted[0])
    assert torch.allclose(scenes.surface_radiance(rendering), torch.full((3,), cosine), rtol=0.02)


def test_a_lid_casts_a_shadow() -> None:
    """Under a sun at the zenith the floor is white where the lid is not, and black beneath it."""
    for x, truth in ((-0.5, 1.0), (0.5, 0.0)):
        camera = Camera((x, 0.25, 2.0), (x, 0.0, 0.0), vertical_fov=0.05)
        view = View(camera, scenes.sun(1, 0, rows=180, cols=4), 4, 4)
        white = scenes.lambertian((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
        rendering = scenes.picture(DIRECT, scenes.occluder(), white, view, spp=16)
        assert (rendering.coverage == 1.0).all()
        assert torch.allclose(scenes.surface_radiance(rendering), torch.full((3,), truth), rtol=0.03)


def test_black_light_gives_a_black_picture_and_full_coverage() -> None:
    view = scenes.front_view(scenes.constant_light(0.0), vertical_fov=0.2)
    rendering = scenes.picture(DIRECT, scenes.plane(), scenes.lambertian(GREY), view)
    assert (rendering.image == 0.0).all()
    assert (rendering.coverage == 1.0).all()


def test_coverage_is_the_share_of_the_pixel() -> None:
    """A unit square fills a film of 2 x 2 units by a quarter; the picture is premultiplied."""
    view = scenes.front_view(scenes.constant_light(), width=10, height=10, vertical_fov=2.0 * math.atan(1.0 / 3.0))
    rendering = scenes.picture(DIRECT, scenes.plane(), scenes.lambertian((1.0, 1.0, 1.0)), view, spp=64)
    edge = rendering.coverage[2, 3:7]
    assert rendering.coverage.mean() == pytest.approx(0.25, abs=0.01)
    assert torch.allclose(edge, torch.full_like(edge, 0.5), atol=0.25)
    assert (rendering.image[0] == 0.0).all()
    assert (rendering.image.mean(dim=-1) / rendering.coverage)[2, 3:7].mean() == pytest.approx(1.0, rel=0.1)


def test_direct_light_is_linear_in_texture_and_in_light() -> None:
    surface, textures = scenes.sphere(), [scenes.random_texture(8, 8, seed) for seed in (1, 2)]
    view = scenes.front_view(scenes.random_light())
    sums = [scenes.picture(DIRECT, surface, scenes.lambertian(t), view).image for t in (*textures, sum(textures))]
    assert torch.allclose(sums[0] + sums[1], sums[2], atol=1e-6)
    brighter = scenes.front_view(Environment(7.0 * view.environment.radiance))
    bright = scenes.picture(DIRECT, surface, scenes.lambertian(textures[0]), brighter).image
    assert torch.allclose(bright, 7.0 * sums[0], rtol=1e-5)


def test_bounced_light_takes_the_colour_of_the_wall() -> None:
    """A red wall reddens the white floor beside it, and only by interreflection."""
    view = View(Camera((0.5, 1.5, 0.9), (0.3, 0.0, 0.5), vertical_fov=0.2), scenes.constant_light(), 6, 6)
    materials = scenes.lambertian((0.8, 0.8, 0.8), (0.8, 0.0, 0.0), (0.0, 0.0, 0.0))
    direct, bounced = (
        scenes.surface_radiance(scenes.picture(NumpyRenderer(n), scenes.corner_box(), materials, view, spp=64))
        for n in (1, 2)
    )
    assert direct[0] == pytest.approx(float(direct[1]))
    assert bounced[0] > 1.1 * direct[0]
    assert bounced[1] == pytest.approx(float(direct[1]), rel=1e-5)
