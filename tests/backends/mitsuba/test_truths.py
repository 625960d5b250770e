"""Pictures whose answer is known beforehand."""

import math

import numpy as np
import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Environment, Material, Materials, View

GREY = (0.6, 0.3, 0.9)
WHITE = scenes.lambertian((1.0, 1.0, 1.0))


@pytest.mark.parametrize("rotation", [0.0, 1.0])
def test_a_plane_in_uniform_light_has_its_base_colour(renderer: MitsubaRenderer, rotation: float) -> None:
    view = scenes.front_view(Environment(scenes.constant_light(2.0).radiance, rotation))
    rendering = scenes.picture(renderer, scenes.plane(), scenes.lambertian(GREY), view, spp=256)
    assert torch.allclose(scenes.surface_radiance(rendering), 2.0 * torch.tensor(GREY), rtol=0.01)


def test_white_walls_in_uniform_light_cannot_be_seen() -> None:
    view = scenes.corner_view(scenes.constant_light())
    white = scenes.lambertian(*3 * [(1.0, 1.0, 1.0)])
    rendering = scenes.picture(MitsubaRenderer("cpu", max_bounces=32), scenes.corner_box(), white, view, spp=64)
    assert torch.allclose(scenes.surface_radiance(rendering), torch.ones(3), rtol=0.01)


@pytest.mark.parametrize("max_bounces", [1, 2, 5])
def test_a_bowl_is_a_geometric_series(max_bounces: int) -> None:
    """From any point of a sphere half of it takes half of the cosine-weighted view: it keeps half of the light."""
    truth = sum(0.8**k * 0.5**k for k in range(1, max_bounces + 1))
    view = View(Camera((0.0, 0.0, 0.0), (0.0, -1.0, 0.2), vertical_fov=1.0), scenes.constant_light(), 8, 8)
    bowl, grey = scenes.bowl(), scenes.lambertian((0.8, 0.8, 0.8))
    rendering = scenes.picture(MitsubaRenderer("cpu", max_bounces), bowl, grey, view, spp=1024)
    assert (rendering.coverage == 1.0).all()
    assert float(scenes.surface_radiance(rendering).mean()) == pytest.approx(truth, rel=0.02)


@pytest.mark.parametrize("rotation", [0.0, 0.4])
@pytest.mark.parametrize(("row", "col"), [(32, 0), (20, 10), (32, 16), (12, 120)])
def test_a_small_sun_shines_by_the_cosine(renderer: MitsubaRenderer, row: int, col: int, rotation: float) -> None:
    view = scenes.front_view(scenes.sun(row, col, rotation=rotation), width=4, height=4, vertical_fov=0.2)
    rendering = scenes.picture(renderer, scenes.plane(), scenes.lambertian(GREY), view, spp=64)
    x, _, z = scenes.sun_direction(row, col)
    cosine = math.cos(rotation) * z - math.sin(rotation) * x
    assert cosine > 0.05
    assert torch.allclose(scenes.surface_radiance(rendering), cosine * torch.tensor(GREY), rtol=0.02)


def test_the_shading_normal_alone_decides_the_cosine(renderer: MitsubaRenderer) -> None:
    tilted = np.tile([0.6, 0.0, 0.8], (4, 1))
    flat = scenes.plane()
    surface = scenes.surface_of(flat.positions, 3.0 * tilted, flat.uv, flat.faces)
    view = scenes.front_view(scenes.sun(32, 0), width=4, height=4, vertical_fov=0.2)
    rendering = scenes.picture(renderer, surface, WHITE, view, spp=64)
    cosine = float(scenes.sun_direction(32, 0) @ tilted[0])
    assert torch.allclose(scenes.surface_radiance(rendering), torch.full((3,), cosine), rtol=0.02)


@pytest.mark.parametrize(("x", "truth"), [(-0.5, 1.0), (0.5, 0.0)])
def test_a_lid_casts_a_shadow(renderer: MitsubaRenderer, x: float, truth: float) -> None:
    camera = Camera((x, 0.25, 2.0), (x, 0.0, 0.0), vertical_fov=0.05)
    view = View(camera, scenes.sun(1, 0, rows=180, cols=4), 4, 4)
    white = scenes.lambertian((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))
    rendering = scenes.picture(renderer, scenes.occluder(), white, view, spp=64)
    assert (rendering.coverage == 1.0).all()
    assert torch.allclose(scenes.surface_radiance(rendering), torch.full((3,), truth), rtol=0.03)


def test_black_light_gives_a_black_picture_and_full_coverage(renderer: MitsubaRenderer) -> None:
    view = scenes.front_view(scenes.constant_light(0.0), vertical_fov=0.2)
    rendering = scenes.picture(renderer, scenes.plane(), WHITE, view)
    assert (rendering.image == 0.0).all()
    assert (rendering.coverage == 1.0).all()


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e4])
def test_neither_size_nor_place_matters(renderer: MitsubaRenderer, scale: float) -> None:
    """The same scene in millimetres, metres and far away looks the same."""
    ground = scenes.occluder()
    place = scale * np.array([300.0, -20.0, 100.0])
    moved = scenes.surface_of(
        scale * ground.positions + place, ground.normals, ground.uv, ground.faces, ground.face_part
    )
    colors = scenes.lambertian(scenes.RED, scenes.GREEN)
    eye, target = np.array([1.5, 1.2, 3.0]), np.zeros(3)
    far = Camera(tuple(scale * eye + place), tuple(scale * target + place))
    light = scenes.random_light()
    here = scenes.picture(renderer, ground, colors, View(Camera((1.5, 1.2, 3.0)), light, 12, 9), spp=16)
    there = scenes.picture(renderer, moved, colors, View(far, light, 12, 9), spp=16)
    assert float((here.image - there.image).abs().mean()) < 1e-3 * float(here.image.mean())


def test_rays_that_miss_leave_no_trace(renderer: MitsubaRenderer) -> None:
    away = scenes.quad((0.0, 0.0, 9.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    rendering = scenes.picture(renderer, away, WHITE, scenes.front_view(scenes.random_light()))
    assert (rendering.image == 0.0).all()
    assert (rendering.coverage == 0.0).all()


@pytest.mark.parametrize("roughness", [0.0, 0.2, 0.6, 1.0])
@pytest.mark.parametrize("color", [0.0, 1.0])
def test_glossy_reflection_is_the_integral_of_its_definition(
    renderer: MitsubaRenderer, color: float, roughness: float
) -> None:
    material = Material({"base_color": torch.full((3,), color), "roughness": torch.tensor([roughness])})
    view = scenes.front_view(scenes.constant_light(), distance=20.0, width=4, height=4, vertical_fov=0.01)
    rendering = scenes.picture(renderer, scenes.plane(), Materials((material,)), view, spp=8192)
    seen = float(scenes.surface_radiance(rendering)[0])
    assert seen == pytest.approx(reflected_from_the_front(color, roughness), rel=0.02)


def reflected_from_the_front(color: float, roughness: float) -> float:
    """What a dielectric in uniform light sends along its normal: docs/conventions.md, by the midpoint rule."""
    alpha, steps = max(roughness, 0.05) ** 2, 200_000
    incoming = (np.arange(steps) + 0.5) / steps * np.pi / 2
    half = incoming / 2
    fresnel = 0.04 + 0.96 * (1 - np.cos(half)) ** 5
    facets = alpha**2 / (np.pi * (np.cos(half) ** 2 * (alpha**2 - 1) + 1) ** 2)
    shadowing = 2 / (1 + np.sqrt(1 + (alpha * np.tan(incoming)) ** 2))
    diffuse = (1 - fresnel) * color / np.pi * np.cos(incoming)
    solid_angle = 2 * np.pi * np.sin(incoming) * np.pi / 2 / steps
    return float(((diffuse + fresnel * facets * shadowing / 4) * solid_angle).sum())
