"""Which way everything points."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, View

DIRECT = NumpyRenderer()
WHITE = scenes.lambertian((1.0, 1.0, 1.0))
AXES = {"+X": (1, 0, 0), "-X": (-1, 0, 0), "+Y": (0, 1, 0), "-Y": (0, -1, 0), "+Z": (0, 0, 1), "-Z": (0, 0, -1)}


@pytest.mark.parametrize(("x", "y", "row", "col"), [(0.5, 0.5, 1, 6), (-0.5, 0.5, 1, 1), (0.5, -0.5, 6, 6)])
def test_row_0_is_the_top_and_x_points_right(x: float, y: float, row: int, col: int) -> None:
    view = scenes.front_view(scenes.constant_light(), 2.0, 8, 8, 2.0 * math.atan(0.4))
    small = scenes.quad((x - 0.1, y - 0.1, 0.0), (0.2, 0.0, 0.0), (0.0, 0.2, 0.0))
    coverage = scenes.picture(DIRECT, small, WHITE, view, spp=16).coverage
    assert divmod(int(coverage.argmax()), 8) == (row, col)


def test_pixels_are_square() -> None:
    view = scenes.front_view(scenes.constant_light(), 2.0, 16, 8, 2.0 * math.atan(0.5))
    coverage = scenes.picture(DIRECT, scenes.plane(1.0), WHITE, view, spp=16).coverage
    truth = torch.zeros(8, 16)
    truth[2:6, 6:10] = 1.0
    assert torch.equal(coverage, truth)


def test_a_camera_looks_at_its_target_with_up_up() -> None:
    camera = Camera((3.0, 0.0, 0.0), (0.0, 0.0, 0.0), up=(0.0, 0.0, 1.0), vertical_fov=0.8)
    spot = scenes.quad((0.0, 0.4, 0.4), (0.0, 0.2, 0.0), (0.0, 0.0, 0.2))  # +Z is up, so +Y is to the right
    coverage = scenes.picture(DIRECT, spot, WHITE, View(camera, scenes.constant_light(), 9, 9), spp=16).coverage
    assert divmod(int(coverage.argmax()), 9) == (2, 6)


def test_texture_row_0_is_at_the_bottom() -> None:
    texture = torch.tensor([[[1.0, 0, 0], [0, 1, 0]], [[0, 0, 1], [1, 1, 1]]])
    view = scenes.front_view(scenes.constant_light(), 2.0, 8, 8, 2.0 * math.atan(0.25))
    image = scenes.picture(DIRECT, scenes.plane(), scenes.lambertian(texture), view, spp=256).image
    for (row, col), color in {(7, 0): (1, 0, 0), (7, 7): (0, 1, 0), (0, 0): (0, 0, 1), (0, 7): (1, 1, 1)}.items():
        assert torch.allclose(image[row, col], torch.tensor(color, dtype=torch.float32), atol=0.1)


@pytest.mark.parametrize(
    ("row", "col", "rotation", "axis"),
    [
        (32, 64, 0.0, "-Z"),
        (32, 96, 0.0, "+X"),
        (32, 0, 0.0, "+Z"),
        (32, 127, 0.0, "+Z"),
        (32, 32, 0.0, "-X"),
        (1, 5, 0.0, "+Y"),
        (62, 70, 0.0, "-Y"),
        (32, 64, math.pi / 2, "-X"),
        (32, 96, math.pi / 2, "-Z"),
        (32, 96, -math.pi / 2, "+Z"),
        (1, 5, 1.0, "+Y"),
    ],
)
def test_the_sun_shines_from_where_it_is(row: int, col: int, rotation: float, axis: str) -> None:
    for name, direction in AXES.items():
        assert _brightness(direction, row, col, rotation) == pytest.approx(float(name == axis), abs=0.08)


def _brightness(normal: tuple[int, int, int], row: int, col: int, rotation: float) -> float:
    """Of a white square that faces an axis, seen from there."""
    right = np.roll(normal, 1)
    surface = scenes.quad(tuple(-0.5 * (right + np.cross(normal, right))), right, np.cross(normal, right))
    camera = Camera(tuple(2.0 * np.array(normal)), up=tuple(right), vertical_fov=0.1)
    rendering = scenes.picture(DIRECT, surface, WHITE, View(camera, scenes.sun(row, col, rotation=rotation), 2, 2))
    return float(rendering.image.mean())


def test_both_windings_and_both_normals_look_alike() -> None:
    surface, view = scenes.sphere(), scenes.front_view(scenes.random_light())
    materials = scenes.lambertian(scenes.random_texture(8, 8))
    flipped = dataclasses.replace(surface, faces=surface.faces[:, ::-1].copy())
    inward = dataclasses.replace(surface, normals=-surface.normals)
    image = scenes.picture(DIRECT, surface, materials, view).image
    assert torch.allclose(scenes.picture(DIRECT, flipped, materials, view).image, image, atol=1e-5)
    # the frame about a turned normal is another one, so the samples are too
    assert scenes.picture(DIRECT, inward, materials, view, 64).image.mean() == pytest.approx(
        float(scenes.picture(DIRECT, surface, materials, view, 64).image.mean()), rel=0.02
    )


def test_each_part_has_its_own_material() -> None:
    view = scenes.front_view(scenes.constant_light(), 2.0, 8, 8, 2.0 * math.atan(0.45))
    image = scenes.picture(DIRECT, scenes.two_parts(), scenes.lambertian(scenes.RED, scenes.GREEN), view, 64).image
    assert torch.allclose(image[:, :4].mean(dim=(0, 1)), torch.tensor(scenes.RED), rtol=0.02)
    assert torch.allclose(image[:, 4:].mean(dim=(0, 1)), torch.tensor(scenes.GREEN), rtol=0.02)


def test_textures_repeat_only_where_the_surface_says_so() -> None:
    """At the left edge of a texture that is black at the left and white at the right."""
    texture = torch.tensor([0.0, 1.0])[None, :, None].expand(2, 2, 3)
    camera = Camera((-0.499, 0.0, 1.0), (-0.499, 0.0, 0.0), vertical_fov=0.001)
    view, plane = View(camera, scenes.constant_light(), 2, 2), scenes.plane()
    for repeat, truth in (((False, False), 0.0), ((False, True), 0.0), ((True, False), 0.5)):
        surface = dataclasses.replace(plane, repeat=repeat)
        image = scenes.picture(DIRECT, surface, scenes.lambertian(texture), view, spp=64).image
        assert float(image.mean()) == pytest.approx(truth, abs=0.02)
