"""Pictures with known answers."""

import numpy as np
import pytest
import torch
from svbrdfgan_mitsuba import MitsubaRenderer, variant
from svbrdfgan_mitsuba.bsdf import MetallicRoughness
from svbrdfgan_mitsuba.interop import dr

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Material, Materials, View


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


@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
def test_the_density_at_grazing_view_is_its_limit(renderer: MitsubaRenderer, roughness: float) -> None:
    mi = variant.load(renderer.device)
    incoming = dr.normalize(mi.Vector3f([0.0, -0.9, 0.3], [0.1, 0.0, 0.2], [1.0, 0.1, 0.1]))
    viewers = [dr.normalize(mi.Vector3f(1.0, 0.0, cosine)) for cosine in (0.0, 1e-6)]
    made = [
        MetallicRoughness(mi, mi.Color3f(0.5), None, mi.Float(roughness), None, mi.Bool(True), viewer)
        for viewer in viewers
    ]
    at, near = (each.density(incoming).numpy() for each in made)
    np.testing.assert_allclose(at, near, rtol=0.01)


def reflected_from_the_front(color: float, roughness: float) -> float:
    """The radiance of a dielectric along its normal in uniform light, by docs/conventions.md and the midpoint rule."""
    alpha, steps = max(roughness, 0.05) ** 2, 200_000
    incoming = (np.arange(steps) + 0.5) / steps * np.pi / 2
    half = incoming / 2
    fresnel = 0.04 + 0.96 * (1 - np.cos(half)) ** 5
    facets = alpha**2 / (np.pi * (np.cos(half) ** 2 * (alpha**2 - 1) + 1) ** 2)
    shadowing = 2 / (1 + np.sqrt(1 + (alpha * np.tan(incoming)) ** 2))
    diffuse = (1 - fresnel) * color / np.pi * np.cos(incoming)
    solid_angle = 2 * np.pi * np.sin(incoming) * np.pi / 2 / steps
    return float(((diffuse + fresnel * facets * shadowing / 4) * solid_angle).sum())
