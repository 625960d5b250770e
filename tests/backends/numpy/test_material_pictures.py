"""Pictures with gloss that have known answers."""

import math

import gltf
import numpy as np
import pytest
import torch
from svbrdfgan_numpy import NumpyRenderer, bsdf
from torch import Tensor

from svbrdfgan.testing import scenes
from svbrdfgan.types import Camera, Environment, Material, Materials, Surface, View

DIRECT = NumpyRenderer()
WHITE, BLACK = (1.0, 1.0, 1.0), (0.0, 0.0, 0.0)


def _glossy(base_color: tuple[float, ...] | Tensor, roughness: float | Tensor, **maps: float | Tensor) -> Materials:
    return Materials((gltf.glossy(base_color, roughness, **maps),))


def _plane_seen_at(direction: np.ndarray, environment: Environment) -> View:
    """The middle of the `plane`, from 3 m in a direction."""
    return View(Camera(tuple(3.0 * direction), vertical_fov=0.001), environment, 8, 8)


def _mean_and_error(image: Tensor) -> tuple[float, float]:
    """The mean, and its standard error, of a grey picture whose pixels all have the same expectation."""
    pixels = image[..., 0].double()
    return float(pixels.mean()), float(pixels.std()) / math.sqrt(pixels.numel())


@pytest.mark.parametrize("metallic", [0.0, 0.7])
@pytest.mark.parametrize("roughness", [0.3, 0.6])
@pytest.mark.parametrize("offset", [0.0, 0.15, -0.5])
def test_a_small_sun_shines_by_the_formula_at_the_mirror_angle_and_off_it(
    roughness: float, offset: float, metallic: float
) -> None:
    """The sun stands 45 degrees to the right of +Z; the camera at the mirror angle, and turned from there."""
    row, col, rows, cols = 256, 896, 512, 1024
    light = scenes.sun_direction(row, col, rows, cols)
    angle = math.atan2(light[0], light[2]) + offset
    view = np.array([-math.sin(angle), 0.0, math.cos(angle)])
    sun = _plane_seen_at(view, scenes.sun(row, col, rows, cols))
    materials = _glossy((0.5, 0.5, 0.5), roughness, metallic=metallic)
    image = scenes.picture(DIRECT, scenes.plane(), materials, sun, spp=16).image
    truth = math.pi * light[2] * gltf.bsdf(view[None], light[None], 0.5, roughness, metallic)[0]
    assert light == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5)], abs=0.01)
    mean, error = _mean_and_error(image)
    assert abs(mean - truth) < 0.004 * truth + 4.0 * error
    assert error < 0.01 * truth


@pytest.mark.parametrize("texel", [(0.3, 0.0, 0.9), (0.0, 0.5, 0.8), (-0.3, -0.2, 0.7)])
@pytest.mark.parametrize("behind", [False, True])
def test_under_a_small_sun_a_tilted_plane_shines_as_its_normal_says(
    texel: tuple[float, float, float], behind: bool
) -> None:
    """u and v grow along +X and +Y. Seen from behind, relief pushes through: the normal is the opposite one.

    None is so steep that it is bent.
    """
    row, col, rows, cols = 170, 512 if behind else 0, 512, 1024
    light, side = scenes.sun_direction(row, col, rows, cols), -1.0 if behind else 1.0
    view = np.array([0.2, 0.3, side]) / np.linalg.norm([0.2, 0.3, 1.0])
    normal = side * np.array(texel) / np.linalg.norm(texel)
    turn = np.linalg.qr(np.column_stack([normal, np.eye(3)[:, :2]]))[0].T[[1, 2, 0]]
    turn[2] = normal  # a frame whose last axis is the normal: its sign is free in the decomposition
    local = [turn @ view, turn @ light]
    sun = _plane_seen_at(view, scenes.sun(row, col, rows, cols))
    for roughness, metallic in ((0.5, 0.0), (0.4, 0.8)):
        materials = _glossy((0.5, 0.5, 0.5), roughness, metallic=metallic, normal=torch.tensor(texel))
        image = scenes.picture(DIRECT, scenes.plane(), materials, sun, spp=16).image
        truth = math.pi * (normal @ light) * gltf.bsdf(local[0][None], local[1][None], 0.5, roughness, metallic)[0]
        mean, error = _mean_and_error(image)
        assert abs(mean - truth) < 0.008 * truth + 4.0 * error
        assert error < 0.02 * truth
    dull = Materials((Material({"base_color": torch.full((3,), 0.5), "normal": torch.tensor(texel)}),))
    image = scenes.picture(DIRECT, scenes.plane(), dull, sun, spp=16).image
    assert float(image.mean()) == pytest.approx(0.5 * (normal @ light), rel=0.01)


def test_light_from_behind_a_tilted_plane_does_not_count() -> None:
    """In front of its normal stands a sun, at first before and then behind the plane."""
    normal = torch.tensor([0.8, 0.0, 0.6])
    for col, lit in ((102, True), (90, False)):
        light = scenes.sun_direction(32, col)
        view = scenes.front_view(scenes.sun(32, col), vertical_fov=0.2)
        image = scenes.picture(DIRECT, scenes.plane(), _glossy(WHITE, 0.5, normal=normal), view).image
        assert light @ normal.numpy() > 0.3
        assert (light[2] > 0.2) if lit else (light[2] < -0.2)
        assert (image > 0.0).any() == lit


def test_a_flat_normal_map_and_no_metal_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """But the directions that are drawn, so here none is drawn evenly."""
    monkeypatch.setattr(bsdf, "EVEN", 0.0)
    view = scenes.corner_view(scenes.random_light())
    for kind in ({}, {"roughness": torch.tensor([0.3])}):
        plain = {"base_color": scenes.random_texture(4, 4), **kind}
        neutral = {**plain, "normal": torch.tensor([0.0, 0.0, 0.5])}
        if kind:
            neutral["metallic"] = torch.zeros(2, 2, 1)
        images = [
            scenes.picture(NumpyRenderer(3), scenes.corner_box(), Materials((Material(maps),) * 3), view).image
            for maps in (plain, neutral)
        ]
        assert torch.allclose(images[0], images[1], rtol=1e-6)


@pytest.mark.parametrize("max_bounces", [1, 3])
@pytest.mark.parametrize("metallic", [0.0, 1.0])
@pytest.mark.parametrize("roughness", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("cosine", [0.95, 0.3])
def test_furnace_a_plane_in_uniform_light_has_its_albedo(
    cosine: float, roughness: float, metallic: float, max_bounces: int
) -> None:
    view = _plane_seen_at(gltf.direction(cosine)[0], scenes.constant_light())
    for grey in (1.0, 0.1):
        materials = _glossy((grey, grey, grey), roughness, metallic=metallic)
        image = scenes.picture(NumpyRenderer(max_bounces), scenes.plane(), materials, view, spp=64).image
        mean, error = _mean_and_error(image)
        assert abs(mean - gltf.albedo(cosine, grey, max(roughness, 0.05), metallic)) < 4.5 * error
        assert error < 0.05 * mean


@pytest.mark.parametrize(("base_color", "metallic"), [(0.0, 0.0), (0.8, 0.0), (0.8, 1.0)])
def test_furnace_gloss_among_white_walls_reflects_them_as_if_they_were_light(
    base_color: float, metallic: float
) -> None:
    """White walls in uniform light cannot be seen.

    A glossy chip that mirrors them, too small to change them, shines as in the open, if paths go on from it with the
    right weight. With direct light alone it is darker.
    """
    chip = scenes.quad((0.25, 0.2, 0.27), (0.02, 0.0, 0.0), (0.0, 0.0, -0.02))
    target, toward = chip.positions.mean(axis=0), np.array([1.6, 1.4, 1.8])
    view = View(Camera(tuple(target + toward), tuple(target), vertical_fov=0.001), scenes.constant_light(), 8, 8)
    surface = scenes.joined(scenes.corner_box(), chip)
    shiny = gltf.glossy(3 * (base_color,), 0.3, metallic=metallic)
    materials = Materials((*scenes.lambertian(WHITE, WHITE, WHITE).parts, shiny))
    truth = gltf.albedo(1.4 / float(np.linalg.norm(toward)), base_color, 0.3, metallic)
    mean, error = _mean_and_error(scenes.picture(NumpyRenderer(32), surface, materials, view, spp=96).image)
    direct, _ = _mean_and_error(scenes.picture(DIRECT, surface, materials, view, spp=64).image)
    assert abs(mean - truth) < 4.5 * error
    assert error < 0.04 * truth
    assert direct < 0.7 * truth


def test_a_roughness_map_lies_as_a_base_colour_does() -> None:
    """Black but for its gloss in uniform light, the smooth corner at u = 1, v = 1 is the brightest."""
    roughness = torch.ones(2, 2, 1)
    roughness[1, 1] = 0.1
    view = scenes.front_view(scenes.constant_light(), 2.0, 8, 8, 2.0 * math.atan(0.25))
    image = scenes.picture(DIRECT, scenes.plane(), _glossy(BLACK, roughness), view, spp=256).image[..., 0]
    top_right, others = image[:2, -2:].mean(), [image[:2, :2], image[-2:, :2], image[-2:, -2:]]
    assert top_right == pytest.approx(gltf.albedo(0.95, 0.0, 0.1), rel=0.1)
    assert all(other.mean() == pytest.approx(gltf.albedo(0.95, 0.0, 1.0), rel=0.1) for other in others)


def test_the_map_is_looked_up_first_and_then_bounded() -> None:
    """Halfway between texels of -0.2 and 0.4 the roughness is 0.1, not the mean of 0.05 and 0.4."""
    view = View(Camera((0.0, 0.0, 3.0), vertical_fov=1e-5), scenes.random_light(), 8, 8)
    halfway = torch.tensor([-0.2, 0.4])[None, :, None].double()
    image, truth, other = (
        scenes.picture(DIRECT, scenes.plane(), _glossy(BLACK, roughness), view).image
        for roughness in (halfway, torch.tensor(0.1).double(), torch.tensor(0.225).double())
    )
    assert torch.allclose(image, truth, rtol=1e-3)
    assert not torch.allclose(image, other, rtol=0.1)


def test_smoother_than_the_least_roughness_is_the_least() -> None:
    view = scenes.front_view(scenes.random_light(), vertical_fov=0.2)
    mirror, smooth, least, more = (
        scenes.picture(DIRECT, scenes.plane(), _glossy(WHITE, roughness), view).image
        for roughness in (0.0, 0.04, 0.05, 0.06)
    )
    assert torch.equal(mirror, smooth)
    assert torch.allclose(smooth, least, rtol=1e-5)
    assert not torch.allclose(least, more, rtol=1e-3)


def test_direct_light_is_affine_in_the_base_colour() -> None:
    def image(color: Tensor) -> Tensor:
        return scenes.picture(DIRECT, scenes.sphere(), _glossy(color, 0.3), view).image

    view, colors = scenes.front_view(scenes.random_light()), [scenes.random_texture(8, 8, seed) for seed in (1, 2)]
    assert torch.allclose(image(colors[0]) + image(colors[1]), image(sum(colors)) + image(torch.zeros(3)), atol=1e-6)
    assert image(torch.zeros(3)).max() > 0.01


def test_a_lambertian_part_looks_the_same_beside_a_glossy_one() -> None:
    view = scenes.front_view(scenes.random_light(), vertical_fov=0.6)
    red, shiny = Material.lambertian(scenes.RED), gltf.glossy(scenes.GREEN, 0.2)
    beside, alone = (
        scenes.picture(NumpyRenderer(2), scenes.two_parts(), Materials((red, other)), view).image
        for other in (shiny, Material.lambertian(scenes.GREEN))
    )
    assert torch.equal(beside[:, :8], alone[:, :8])
    assert not torch.equal(beside[:, 8:], alone[:, 8:])


def test_the_same_seed_gives_the_same_glossy_picture_however_it_is_cut() -> None:
    surface: Surface = scenes.corner_box()
    view = scenes.corner_view(scenes.random_light(), width=5, height=4)
    materials = Materials(
        (gltf.glossy(WHITE, scenes.random_texture(3, 4)[..., :1]), *scenes.lambertian(scenes.RED, WHITE).parts)
    )
    images = [scenes.picture(NumpyRenderer(3, chunk), surface, materials, view).image for chunk in (100_000, 100, 1)]
    assert all(torch.equal(images[0], image) for image in images[1:])
