"""The balls beside a picture show the light from where it comes."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import trimesh
from numpy import ndarray
from PIL import Image

from svbrdfgan.data.photos.light_balls import beside, light_balls
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.types import Camera, Environment, Material, Materials, Mesh, Part, View

SIDE = 40
FRONT = Camera.orbit(0.0, 0.0, 5.0, (0.0, 0.0, 0.0), math.radians(30))


def lamp(row: int, col: int) -> torch.Tensor:
    """A map of 16 x 32 pixels, dim but for one."""
    radiance = torch.full((16, 32, 3), 0.01)
    radiance[row, col] = torch.tensor([30.0, 20.0, 10.0])
    return radiance


def brightest(ball: ndarray) -> tuple[float, float]:
    """The place of the light on a ball, from -1 to 1, to the right and up."""
    inside = (ball != 1.0).any(axis=-1)
    weight = np.where(inside, ball[..., 0], 0.0)
    weight = weight * (weight > 0.5 * weight.max())
    row, col = np.indices(weight.shape)
    return float((weight * (col + 0.5)).sum() / weight.sum() / SIDE * 2 - 1), float(
        1 - (weight * (row + 0.5)).sum() / weight.sum() / SIDE * 2
    )


@pytest.mark.parametrize(
    ("camera", "rotation", "where"),
    [
        (0.0, 0.0, (1, 0)),  # the map's +X column is to the right of who looks towards -Z
        (0.0, math.pi, (-1, 0)),
        (math.pi, 0.0, (-1, 0)),  # from behind it is on the left
        (0.0, math.pi / 2, (0, 0)),  # turned counter-clockwise seen from above: now behind the ball, at its rim
    ],
)
def test_light_comes_from_where_it_is(camera: float, rotation: float, where: tuple[int, int]) -> None:
    seen = Camera.orbit(camera, 0.0, 5.0, (0.0, 0.0, 0.0), math.radians(30))
    chrome, grey = light_balls(Environment(lamp(8, 24), rotation), seen, SIDE)
    x, y = brightest(chrome)
    if where[0]:
        assert x * where[0] > 0.5
        assert abs(y) < 0.1
        assert brightest(grey)[0] * where[0] > 0.3
    else:
        middle = slice(SIDE // 2 - 3, SIDE // 2 + 3)
        assert grey[middle, middle].max() < 0.4 * grey[(grey != 1.0).any(axis=-1)].max()


def test_the_grey_ball_is_what_a_renderer_makes_of_it() -> None:
    """A matt sphere in a coloured light from above; its middle half."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    mesh = Mesh(ball.vertices, ball.faces, np.zeros(len(ball.faces), int), (Part("ball"),))
    surface = load_embedding("hemispherical", {"resolution": 32}).embed(mesh)
    renderer = load_renderer("mitsuba", {"device": "cpu"})
    light = Environment(lamp(3, 20), 0.6)
    grey = Materials((Material.lambertian((0.18,) * 3),) * len(surface.parts))
    view = View(Camera.orbit(0.4, 0.2, 60.0, (0.0, 0.0, 0.0), 2 * math.atan(1 / 60)), light, SIDE, SIDE)
    made = renderer.render(renderer.prepare(surface), grey, view, spp=256, seed=1).image.numpy()
    shown = light_balls(light, view.camera, SIDE)[1]
    middle = slice(SIDE // 4, -SIDE // 4)
    made, shown = made[middle, middle], shown[middle, middle]
    made = made * (shown.mean() / made.mean())
    assert np.abs(made - shown).mean() < 0.06 * shown.mean()


def test_they_stand_beside_the_picture() -> None:
    shown = beside(Image.new("RGB", (90, 60), "navy"), Environment(torch.ones(8, 16, 3)), FRONT)
    assert shown.size == (110, 60)
    assert shown.getpixel((89, 30)) == (0, 0, 128)
    chrome, grey = (shown.getpixel((100, y)) for y in (10, 30))
    assert isinstance(chrome, tuple)
    assert isinstance(grey, tuple)
    assert chrome == (255, 255, 255)  # even light is five times as bright as what 18 % grey returns
    assert 150 < grey[0] < 200
    assert shown.getpixel((100, 55)) == (255, 255, 255)
