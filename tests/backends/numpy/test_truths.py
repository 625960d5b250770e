"""Pictures with known answers."""

import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, View

DIRECT = NumpyRenderer()


def test_furnace_white_walls_in_uniform_light_cannot_be_seen() -> None:
    view = scenes.corner_view(scenes.constant_light())
    white = scenes.lambertian(*3 * [(1.0, 1.0, 1.0)])
    rendering = scenes.picture(NumpyRenderer(max_bounces=32), scenes.corner_box(), white, view, spp=32)
    direct = scenes.picture(DIRECT, scenes.corner_box(), white, view, spp=32)
    assert torch.allclose(scenes.surface_radiance(rendering), torch.ones(3), rtol=0.01)
    assert (scenes.surface_radiance(direct) < 0.9).all()


@pytest.mark.parametrize("max_bounces", [1, 3, *(pytest.param(count, marks=pytest.mark.full) for count in (2, 8))])
def test_a_bowl_is_a_geometric_series(max_bounces: int) -> None:
    """From any point of a sphere half of it takes half of the cosine-weighted view: it keeps half of the light."""
    truth = sum(0.8**k * 0.5**k for k in range(1, max_bounces + 1))
    view = View(Camera((0.0, 0.0, 0.0), (0.0, -1.0, 0.2), vertical_fov=1.0), scenes.constant_light(), 8, 8)
    rendering = scenes.picture(
        NumpyRenderer(max_bounces), scenes.bowl(), scenes.lambertian((0.8, 0.8, 0.8)), view, spp=256
    )
    assert (rendering.coverage == 1.0).all()
    assert float(scenes.surface_radiance(rendering).mean()) == pytest.approx(truth, rel=0.03)  # 4 standard deviations


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
