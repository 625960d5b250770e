"""Pictures whose answer is known without a renderer."""

import math

import pytest
import torch
from svbrdfgan_warp import WarpRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Materials, Surface, View

WHITE = (1.0, 1.0, 1.0)


def mean_over_seeds(renderer, surface, materials, view, spp, seeds):
    """The mean picture, and the standard error of each value."""
    prepared = renderer.prepare(surface)
    pictures = [renderer.render(prepared, materials, view, spp=spp, seed=seed).image.double() for seed in range(seeds)]
    stack = torch.stack(pictures)
    return stack.mean(dim=0), stack.std(dim=0) / math.sqrt(seeds)


def test_a_convex_body_in_even_light_shows_albedo_times_radiance(renderer: WarpRenderer) -> None:
    light, albedo = (1.0, 2.0, 3.0), (0.5, 0.25, 1.0)
    view = scenes.front_view(scenes.constant_light(light))
    prepared = renderer.prepare(scenes.sphere(1.0, 32, 64))
    means = torch.stack(
        [
            scenes.surface_radiance(renderer.render(prepared, scenes.lambertian(albedo), view, spp=64, seed=seed))
            for seed in range(16)
        ]
    )
    error = means.std(dim=0) / 4
    assert ((means.mean(dim=0) - torch.tensor(light) * torch.tensor(albedo)).abs() <= 4 * error).all()
    assert (error < 0.002 * torch.tensor(light)).all()


@pytest.mark.parametrize("rotation", [0.0, 0.6])
def test_a_small_sun_lights_by_its_cosine(renderer: WarpRenderer, rotation: float) -> None:
    row, col = 20, 84
    x, _, z = scenes.sun_direction(row, col)
    expected = x * math.cos(rotation) + z * math.sin(rotation)
    wall = scenes.quad((0.0, -1.0, 1.0), (0.0, 0.0, -2.0), (0.0, 2.0, 0.0))  # faces +X
    view = View(Camera((3.0, 0.0, 0.1)), scenes.sun(row, col, rotation=rotation), 9, 9)
    seen = scenes.picture(renderer, wall, scenes.lambertian(WHITE), view, spp=256)
    assert torch.allclose(scenes.surface_radiance(seen), torch.tensor(expected, dtype=torch.float32), rtol=0.01)


@pytest.mark.parametrize(("rotation", "bright"), [(0.0, "right"), (math.pi, "left"), (math.pi / 2, "far")])
def test_rotation_turns_the_light_counter_clockwise_seen_from_above(
    renderer: WarpRenderer, rotation: float, bright: str
) -> None:
    """A low sun at +X lights three walls of which each faces another way; a quarter turn brings +X to -Z."""
    walls = {
        "right": scenes.quad((0.0, -1.0, 1.0), (0.0, 0.0, -2.0), (0.0, 2.0, 0.0)),  # faces +X
        "far": scenes.quad((1.0, -1.0, 0.0), (-2.0, 0.0, 0.0), (0.0, 2.0, 0.0)),  # faces -Z
    }
    walls["left"] = scenes.quad((0.0, -1.0, -1.0), (0.0, 0.0, 2.0), (0.0, 2.0, 0.0))  # faces -X
    eyes = {"right": (3.0, 0.0, 0.1), "far": (0.1, 0.0, -3.0), "left": (-3.0, 0.0, 0.1)}
    light = scenes.sun(32, 96, rotation=rotation)  # u = 0.75: +X
    for name, wall in walls.items():
        view = View(Camera(eyes[name]), light, 4, 4)
        seen = scenes.surface_radiance(scenes.picture(renderer, wall, scenes.lambertian(WHITE), view, spp=64))
        assert seen[0] > 0.9 if name == bright else seen[0] < 0.1, name


@pytest.mark.parametrize("col", [0, 127])
def test_light_passes_around_the_seam(renderer: WarpRenderer, col: int) -> None:
    """A sun in the first or last column stands at +Z, and half of its bilinear tent lies across the seam."""
    view = scenes.front_view(scenes.sun(32, col))
    seen = scenes.picture(renderer, scenes.plane(), scenes.lambertian(WHITE), view, spp=256)
    assert scenes.surface_radiance(seen)[0] == pytest.approx(scenes.sun_direction(32, col)[2], rel=0.01)


def test_a_lid_throws_its_shadow_under_itself(renderer: WarpRenderer) -> None:
    """A sun near the zenith: under the lid (u > 1/2) the floor is black, beside it lit."""
    view = View(Camera((-1.5, 0.45, 3.0)), scenes.sun(1, 0), 24, 24)
    prepared = renderer.prepare(scenes.occluder())
    (samples,) = renderer.transport(prepared, view, spp=16, seed=0)
    (u, v), on_floor = samples.uv.unbind(1), samples.part == 0
    inside = on_floor & (v > 0.1)  # the sun shines in a little from the front
    lit, dark = samples.weight[on_floor & (u < 0.45)], samples.weight[inside & (u > 0.55)]
    assert float(lit.mean()) * 16 == pytest.approx(scenes.sun_direction(1, 0)[1], rel=0.02)
    assert len(dark) > 100
    assert dark.max() == 0.0


def test_both_sides_shade_alike(renderer: WarpRenderer) -> None:
    front = scenes.plane(2.0)
    back = scenes.quad((1.0, -1.0, 0.0), (-2.0, 0.0, 0.0), (0.0, 2.0, 0.0))
    view, materials = scenes.front_view(scenes.random_light()), scenes.lambertian(WHITE)
    a, b = (scenes.picture(renderer, surface, materials, view, spp=16) for surface in (front, back))
    assert torch.allclose(a.image, b.image, rtol=1e-4, atol=1e-5)
    assert a.image.mean() > 0.1


def test_a_texture_lies_with_its_origin_at_the_lower_left(renderer: WarpRenderer) -> None:
    texture = torch.zeros(2, 2, 3)
    texture[0, 0, 0], texture[0, 1, 1], texture[1, 0, 2] = 1.0, 1.0, 1.0  # red below left, green right, blue above left
    view = View(Camera((0.0, 0.0, 3.0), vertical_fov=2 * math.atan(1 / 3)), scenes.constant_light(), 8, 8)
    image = scenes.picture(renderer, scenes.plane(2.0), scenes.lambertian(texture), view, spp=16).image
    corners = {(7, 0): 0, (7, 7): 1, (0, 0): 2}
    for pixel, channel in corners.items():
        assert image[pixel][channel] > 0.8
        assert image[pixel].sum() - image[pixel][channel] < 0.01
    assert image[0, 7].sum() < 0.01


def test_bilinear_lookup_between_texels_is_linear(renderer: WarpRenderer) -> None:
    texture = torch.tensor([0.0, 1.0])[None, :, None].expand(1, 2, 3)
    view = View(Camera((0.0, 0.0, 3.0), vertical_fov=2 * math.atan(1 / 3)), scenes.constant_light(), 16, 16)
    prepared = renderer.prepare(scenes.plane(2.0))
    white = renderer.render(prepared, scenes.lambertian(WHITE), view, spp=64, seed=3).image
    image = renderer.render(prepared, scenes.lambertian(texture), view, spp=64, seed=3).image
    u = (torch.arange(16) + 0.5) / 16
    expected = (u * 2 - 0.5).clamp(0, 1)[None, :].expand(16, 16)
    assert torch.allclose((image / white)[..., 0], expected, atol=0.02)


def test_each_part_has_its_own_material(renderer: WarpRenderer) -> None:
    view = scenes.front_view(scenes.constant_light())
    materials = scenes.lambertian(scenes.RED, torch.tensor(scenes.GREEN).expand(5, 3, 3))
    image = scenes.picture(renderer, scenes.two_parts(), materials, view, spp=64).image
    assert torch.allclose(image[8, 5] / image[8, 5].sum(), torch.tensor(scenes.RED), atol=1e-3)
    assert torch.allclose(image[8, 10] / image[8, 10].sum(), torch.tensor(scenes.GREEN), atol=1e-3)


def test_a_wide_film_has_square_pixels(renderer: WarpRenderer) -> None:
    """A unit disc of known angle covers as many columns as rows, and its centre is the film's."""
    view = scenes.front_view(scenes.constant_light(), distance=4.0, width=30, height=14)
    coverage = scenes.picture(renderer, scenes.sphere(1.0, 32, 64), scenes.lambertian(WHITE), view, spp=64).coverage
    assert coverage.shape == (14, 30)
    radius = 14 / 2 * math.tan(math.asin(1 / 4)) / math.tan(0.4)
    assert coverage.sum() == pytest.approx(math.pi * radius**2, rel=0.02)
    rows, cols = torch.meshgrid(torch.arange(14.0), torch.arange(30.0), indexing="ij")
    centre = [float((axis * coverage).sum() / coverage.sum()) for axis in (rows, cols)]
    assert centre == pytest.approx([6.5, 14.5], abs=0.05)


@pytest.mark.parametrize(("scale", "away"), [(1e-3, 0.0), (1.0, 1e4), (1e3, 0.0)])
def test_size_and_place_do_not_matter(renderer: WarpRenderer, scale: float, away: float) -> None:
    """The rays' offsets follow the scene: a sphere does not shadow itself at any size, or far from the origin."""
    unit = scenes.sphere(1.0, 32, 64)
    moved = scenes.surface_of(unit.positions * scale + away, unit.normals, unit.uv, unit.faces)
    camera = Camera((away, away, away + 3.0 * scale), (away, away, away), vertical_fov=0.8)
    view = View(camera, scenes.constant_light(), 16, 16)
    seen = scenes.picture(renderer, moved, scenes.lambertian(WHITE), view, spp=256)
    assert scenes.surface_radiance(seen)[0] == pytest.approx(1.0, rel=0.01)


def test_one_sample_is_as_right_on_average_as_many(renderer: WarpRenderer) -> None:
    view = scenes.front_view(scenes.random_light(rotation=0.4), width=6, height=6)
    scene: tuple[Surface, Materials, View] = (scenes.occluder(), scenes.lambertian(WHITE, scenes.RED), view)
    few, few_error = mean_over_seeds(renderer, *scene, spp=1, seeds=200)
    many, many_error = mean_over_seeds(renderer, *scene, spp=256, seeds=8)
    error = float((few_error**2 + many_error**2).sum().sqrt())
    assert abs(float((few - many).sum())) < 4 * error
