"""The kit's own sums against closed forms."""

import math

import numpy as np
import pytest
import torch

from svbrdfgan.testing import scenes
from svbrdfgan.testing.quadrature import Quadrature
from svbrdfgan.testing.reflection import gloss
from svbrdfgan.testing.renderer import cases
from svbrdfgan.types import Camera, Environment, Materials, Surface, View


def _quadrature(surface: Surface, materials: Materials, view: View, grid: int = 2, split: int = 8) -> Quadrature:
    return Quadrature(surface, materials, view, grid, split)


def _sheet(light: Environment) -> View:
    return scenes.front_view(light, width=4, height=4, vertical_fov=0.5)


def test_white_furnace() -> None:
    """A plane under light of 1 from everywhere shows its base colour."""
    image = _quadrature(scenes.plane(2.0), scenes.lambertian((0.2, 0.5, 1.0)), _sheet(scenes.constant_light())).image()
    assert image == pytest.approx(np.broadcast_to([0.2, 0.5, 1.0], (4, 4, 3)), rel=1e-3)


@pytest.mark.parametrize(("row", "col"), [(32, 127), (20, 115), (40, 10), (50, 60)])
def test_lambert_under_a_small_sun(row: int, col: int) -> None:
    """A sun of irradiance pi lights by the cosine to its middle, and nothing that is turned from it."""
    light = scenes.sun(row, col)
    image = _quadrature(scenes.plane(2.0), scenes.lambertian((0.5, 0.5, 0.5)), _sheet(light), split=4).image()
    assert image == pytest.approx(max(0.5 * scenes.sun_direction(row, col)[2], 0.0), rel=2e-3)


def test_rotation_turns_the_light() -> None:
    """At an angle of pi the light of -Z comes from +Z, and at pi/2 that of +Z comes from +X."""
    behind, before = scenes.sun(32, 64, rotation=math.pi), scenes.sun(32, 0, rotation=math.pi / 2.0)
    white = scenes.lambertian((1.0, 1.0, 1.0))
    side = scenes.quad((0.0, -1.0, 1.0), (0.0, 0.0, -2.0), (0.0, 2.0, 0.0))
    beside = View(Camera((3.0, 0.0, 0.0), vertical_fov=0.5), before, 4, 4)
    assert _quadrature(scenes.plane(2.0), white, _sheet(behind), split=4).image() == pytest.approx(1.0, rel=2e-3)
    assert _quadrature(side, white, beside, split=4).image() == pytest.approx(1.0, rel=2e-3)


def test_form_factor_of_a_lid() -> None:
    """A disc-like square lid above a point hides the share of light that the textbook's form factor says."""
    size, height = 1.0, 0.5
    lid = scenes.quad((-size / 2, height, size / 2), (size, 0.0, 0.0), (0.0, 0.0, -size))
    below = View(Camera((0.0, 0.2, 0.0), up=(0.0, 0.0, -1.0), vertical_fov=0.002), scenes.constant_light(), 1, 1)
    surface = scenes.joined(scenes.floor(2.0), lid)
    image = _quadrature(surface, scenes.lambertian(*[(1.0, 1.0, 1.0)] * 2), below, grid=1, split=64).image()
    x = size / 2 / height
    quarter = 2.0 * x / math.sqrt(1 + x * x) * math.atan(x / math.sqrt(1 + x * x)) / (2.0 * math.pi)
    assert image == pytest.approx(1.0 - 4.0 * quarter, rel=5e-3)


def test_coverage_is_the_share_of_the_pixel() -> None:
    """A square of 1 x 1 m fills the share of the film that perspective gives it."""
    view = scenes.front_view(scenes.constant_light(), 2.0, width=6, height=4, vertical_fov=2.0 * math.atan(0.5))
    coverage = _quadrature(scenes.plane(1.0), scenes.lambertian((1.0, 1.0, 1.0)), view, grid=4).coverage()
    assert coverage.sum() == pytest.approx(4.0)
    assert coverage[1:3, 2:4] == pytest.approx(1.0)


def test_pixels_see_what_lies_there() -> None:
    """Right of the picture is +X and its top +Y; texel row 0 is at the bottom."""
    texture = torch.tensor([[0.1, 0.2], [0.4, 0.8]])[..., None].expand(2, 2, 3)
    view = scenes.front_view(scenes.constant_light(), 2.0, width=8, height=8, vertical_fov=2.0 * math.atan(0.5))
    image = _quadrature(scenes.plane(2.0), scenes.lambertian(texture), view).image()
    assert image[[0, 0, 7, 7], [0, 7, 0, 7], 0] == pytest.approx([0.4, 0.8, 0.1, 0.2])


def test_gloss_at_normal_incidence() -> None:
    """At normal incidence, of roughness 1: D = 1 / pi and G = 1, so that D G / 4 is 1 / (4 pi)."""
    one = np.ones((1, 1))
    schlick, facets = gloss(one, one, one, one)
    assert schlick == pytest.approx(0.0)
    assert facets == pytest.approx(0.25 / math.pi)


def test_gloss_is_reciprocal() -> None:
    """Light and viewer may be exchanged."""
    a, b, between, rough = (np.array([[x]]) for x in (0.9, 0.3, 0.5, 0.4))
    assert gloss(a, b, between, rough)[1] == pytest.approx(gloss(b, a, between, rough)[1])


def test_gloss_has_smiths_masking_of_its_normals() -> None:
    """What is masked from the viewer alone reflects all light: the weak furnace (Heitz 2014)."""
    angle = (np.arange(20000) + 0.5) / 20000 * np.pi / 2.0
    cosine, roughness = np.cos(angle)[None], 0.3
    facets = gloss(cosine, np.ones((1, 1)), cosine, np.full((1, 1), roughness))[1]
    shadowing = 2.0 * cosine / (cosine + np.sqrt(roughness**4 + (1.0 - roughness**4) * cosine**2))
    reflected = (facets / shadowing * cosine * np.sin(angle)).sum() * 2.0 * np.pi * np.pi / 2.0 / 20000
    assert reflected == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("case", [cases.strips(), cases.lidded()], ids=["strips", "lidded"])
def test_gradients_are_those_of_the_image(case: cases.Case) -> None:
    """The image is linear in every texel and in the light, so a difference is the slope."""
    grad = case.random()
    quadrature = _quadrature(case.surface, case.materials, case.view, split=4)
    before, light = (quadrature.image() * grad).sum(), case.view.environment.radiance
    step = torch.rand(light.shape, generator=torch.Generator().manual_seed(1))
    lit = case.lit_by(light + step)
    moved = _quadrature(lit.surface, lit.materials, lit.view, split=4).image()
    slope = (quadrature.environment_gradient(grad) * step.double().numpy()).sum()
    assert (moved * grad).sum() - before == pytest.approx(slope, rel=1e-5, abs=1e-5)
    texels = quadrature.texel_gradients(grad)[0]
    for row, col in ((1, 1), (0, 2)):
        color = case.materials[0].base_color.clone()
        color[row, col, 1] += 0.5
        other = case.with_map(0, "base_color", color)
        picture = _quadrature(other.surface, other.materials, other.view, split=4).image()
        assert (picture * grad).sum() - before == pytest.approx(0.5 * texels[row, col, 1], rel=1e-5, abs=1e-5)


def test_the_gradient_of_roughness_is_that_of_the_image() -> None:
    """By differences of whole pictures, texel by texel."""
    case = cases.glossy(torch.tensor([[0.5, 0.9, 0.6], [0.7, 0.4, 0.8]])[..., None])
    grads, roughness, step = (case.smooth(), case.random()), case.materials[0].maps["roughness"], 1e-2
    found = _quadrature(case.surface, case.materials, case.view).map_gradients("roughness", grads, 0)
    assert found.shape == (2, 2, 3, 1)
    for texel in range(6):
        moved = torch.eye(6)[texel].reshape(2, 3, 1) * step
        more, less = (case.with_map(0, "roughness", roughness + sign * moved) for sign in (1.0, -1.0))
        images = [_quadrature(each.surface, each.materials, each.view).image() for each in (more, less)]
        slope = [((images[0] - images[1]) * grad).sum() / (2.0 * step) for grad in grads]
        assert found.reshape(2, 6)[:, texel] == pytest.approx(slope, rel=5e-3, abs=5e-3 * abs(found).max())


def test_a_shadow_does_not_fall_through_the_floor_nor_upward() -> None:
    """Light from below reaches the lid's underside through no floor, and the floor's top not at all."""
    radiance = torch.zeros(8, 8, 3)
    radiance[5:] = 1.0
    case = cases.lidded().lit_by(radiance)
    assert not _quadrature(case.surface, case.materials, case.view).image().any()
