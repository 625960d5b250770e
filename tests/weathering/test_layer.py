"""Layers in UV space: shape, dtype, independence of scale and place, smoothness from texel to texel."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from svbrdfgan.errors import ConfigError
from svbrdfgan.geometry.bake import bake
from svbrdfgan.geometry.rasterize import Fragments
from svbrdfgan.testing import scenes
from svbrdfgan.weathering.layer import recipe_from_options, weather
from svbrdfgan.weathering.ranges import number
from svbrdfgan.weathering.recipes import RECIPES, Coat, RoadDirt
from svbrdfgan.weathering.recipes.recipe import Options
from svbrdfgan.weathering.recipes.smooth import SmoothRust
from svbrdfgan.weathering.survey import find_site


def test_layer_has_the_buffer_s_shape(vehicle, texels):
    layer = weather(vehicle, texels, RoadDirt()).values
    assert layer.shape == (*texels.position.shape[:2], 4)
    assert layer.dtype == torch.float32


def test_torch_buffers_give_the_same_layer(vehicle, texels, shapes):
    buffer = shapes.Texels(torch.from_numpy(texels.position), torch.from_numpy(texels.normal))
    assert torch.equal(weather(vehicle, buffer, RoadDirt()).values, weather(vehicle, texels, RoadDirt()).values)


@pytest.mark.parametrize("name", RECIPES)
def test_further_maps_follow_alpha_and_stay_in_their_range(vehicle, texels, name):
    recipe = RECIPES[name](seed=3)
    layer = weather(vehicle, texels, recipe, ["metallic", "roughness"])
    assert layer.maps == ("roughness", "metallic")
    assert layer.values.shape == (*texels.position.shape[:2], 6)
    assert torch.equal(layer.rgba, weather(vehicle, texels, recipe).values)
    assert layer.values.min() >= 0.0
    assert layer.values.max() <= 1.0
    rough, metallic, seen = layer["roughness"][..., 0], layer["metallic"][..., 0], layer.alpha > 0.5
    assert rough.std() > 0.01
    assert rough[seen & (metallic < 0.1)].mean() > 0.55
    assert metallic.any() == ("chip" in name)  # smooth rust bares steel with detail only


def test_a_map_that_is_unknown_is_refused(vehicle, texels):
    said = "maps: gloss is unknown; known are base_color, roughness, metallic, normal"
    with pytest.raises(ConfigError, match=said):
        weather(vehicle, texels, RoadDirt(), ["gloss"])
    with pytest.raises(ConfigError, match=said):
        recipe_from_options("road-dirt", {}, ["gloss"])


@dataclass(frozen=True)
class Ridges(Options):
    """A recipe of waves along x or y, of known slope."""

    axis: int = number(0, 0, 2)

    def paint(self, site):
        wave = 0.02 * torch.sin(20.0 * site.position[:, self.axis])
        ones = torch.ones_like(wave)
        return Coat(torch.full_like(site.position, 0.5), ones, ones, 0.0 * ones, wave)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("mirrored", [False, True])
def test_relief_is_the_slope_of_the_height_in_tangent_space(axis, mirrored):
    """Height that grows along +x tilts normals towards -x, whichever way u runs."""
    sheet = scenes.plane(2.0)
    if mirrored:
        sheet = replace(sheet, uv=np.array([1.0, 0.0]) + sheet.uv * [-1.0, 1.0])
    buffer = bake(Fragments.of(sheet, 48, 48))
    normal = weather(sheet, buffer, Ridges(axis=axis), ["normal"])["normal"].double().numpy()
    assert np.allclose(np.linalg.norm(normal, axis=2), 1.0)
    position = buffer.position.double().numpy() / 2.0
    slope = 0.4 * np.cos(20.0 * (position[..., axis] + [0.0, 0.5][axis]))
    wanted = np.zeros_like(normal)
    wanted[..., axis] = -slope * (-1.0 if mirrored and axis == 0 else 1.0)
    wanted[..., 2] = 1.0
    assert np.abs(normal[..., :2] / normal[..., 2:] - wanted[..., :2]).max() < 0.15
    assert np.abs(normal[..., :2] / normal[..., 2:] - wanted[..., :2]).mean() < 0.05


@pytest.mark.parametrize(("scale", "most", "mean"), [(8.0, 1e-6, 1e-8), (10.0, 0.1, 2e-4)])
def test_scale_of_the_model_does_not_matter(vehicle, texels, shapes, scale, most, mean):
    """Powers of two scale without rounding; others move a few samples of the surface over the border of a depth map."""
    recipe = SmoothRust(amount=0.8, seed=3)
    large = shapes.Texels(scale * texels.position, texels.normal)
    scaled, plain = weather(shapes.make_vehicle(scale), large, recipe), weather(vehicle, texels, recipe)
    difference = (scaled.values - plain.values).abs()
    assert difference.max() < most
    assert difference.mean() < mean


@pytest.mark.parametrize("name", [name for name in RECIPES if name.startswith("smooth")])
def test_layers_are_smooth_where_the_surface_is(vehicle, shapes, name):
    """Without detail, texels a hundredth of the length apart differ little on the flank: a network need not guess."""
    z, y = np.meshgrid(np.linspace(-1.6, 1.6, 81), np.linspace(0.4, 0.9, 13))
    position = np.stack([np.full_like(z, 0.8), y, z], axis=-1)
    flank = shapes.Texels(position, np.broadcast_to([1.0, 0.0, 0.0], position.shape))
    layer = weather(vehicle, flank, RECIPES[name](amount=0.8, seed=1, detail=0.0))
    steps = np.abs(np.diff(layer.values.numpy(), axis=1))
    assert np.sqrt(np.square(steps).mean()) < 0.06
    assert layer.alpha.numpy().std() > 0.05


def test_a_site_without_tangents_has_the_same_normals():
    sheet = scenes.plane(2.0)
    buffer = bake(Fragments.of(sheet, 24, 24))
    bare, full = (find_site(sheet, buffer, tangents=tangents) for tangents in (False, True))
    normals = [weather(sheet, buffer, Ridges(), ["normal"], site=site)["normal"] for site in (None, bare, full)]
    assert torch.equal(normals[0], normals[1])
    assert torch.equal(normals[0], normals[2])
    assert normals[0][..., :2].abs().max() > 0.1
