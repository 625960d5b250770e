"""Layers in UV space: shape, dtype, independence of scale and place, smoothness from texel to texel."""

from typing import ClassVar

import numpy as np
import pytest
import torch

from svbrdfgan.errors import ConfigError
from svbrdfgan.weathering import RECIPES, RoadDirt, Rust, recipe_from_options, weather
from svbrdfgan.weathering.recipes import Matter


def test_layer_has_the_buffer_s_shape(vehicle, texels):
    layer = weather(vehicle, texels, RoadDirt())
    assert layer.shape == (*texels.position.shape[:2], 4)
    assert layer.dtype == torch.float32


def test_torch_buffers_give_the_same_layer(vehicle, texels, shapes):
    buffer = shapes.Texels(torch.from_numpy(texels.position), torch.from_numpy(texels.normal))
    assert torch.equal(weather(vehicle, buffer, RoadDirt()), weather(vehicle, texels, RoadDirt()))


@pytest.mark.parametrize("name", RECIPES)
def test_further_maps_follow_alpha_and_stay_in_their_range(vehicle, texels, name):
    recipe = RECIPES[name](seed=3)
    layer = weather(vehicle, texels, recipe, ["roughness"])
    assert layer.shape == (*texels.position.shape[:2], 5)
    assert torch.equal(layer[..., :4], weather(vehicle, texels, recipe))
    least, greatest = recipe.matter["roughness"]
    assert least <= layer[..., 4].min() < layer[..., 4].max() <= greatest
    assert 0.1 * (greatest - least) < layer[..., 4].std() < 0.4 * (greatest - least)


def test_a_map_that_a_recipe_does_not_know_is_refused(vehicle, texels):
    class Paint(RoadDirt):
        matter: ClassVar[Matter] = {"roughness": (0.1, 0.2)}

    said = "Paint has no values for metallic, only for roughness, normal; remove metallic from 'maps'"
    with pytest.raises(ConfigError, match=said):
        weather(vehicle, texels, Paint(), ["metallic"])
    assert weather(vehicle, texels, Paint(), ["normal"]).shape[-1] == 7


@pytest.mark.parametrize("name", RECIPES)
def test_matter_is_no_metal_and_flat(vehicle, texels, name):
    recipe = recipe_from_options(name, {"seed": 3}, ["normal", "metallic", "roughness"])
    layer = weather(vehicle, texels, recipe, ["normal", "metallic", "roughness"])
    assert torch.equal(layer[..., :5], weather(vehicle, texels, recipe, ["roughness"]))
    assert torch.equal(layer[..., 5:], torch.tensor([0.0, 0.0, 0.0, 1.0]).expand(*layer.shape[:2], 4))


@pytest.mark.parametrize(("scale", "most", "mean"), [(8.0, 1e-6, 1e-8), (10.0, 0.1, 2e-4)])
def test_scale_of_the_model_does_not_matter(vehicle, texels, shapes, scale, most, mean):
    """Powers of two scale without rounding; others move a few samples of the surface over the border of a depth map."""
    recipe = Rust(amount=0.8, seed=3)
    large = shapes.Texels(scale * texels.position, texels.normal)
    difference = (weather(shapes.make_vehicle(scale), large, recipe) - weather(vehicle, texels, recipe)).abs()
    assert difference.max() < most
    assert difference.mean() < mean


@pytest.mark.parametrize("name", RECIPES)
def test_layers_are_smooth_where_the_surface_is(vehicle, shapes, name):
    """On the flank, texels a hundredth of the length apart differ little: nothing there for a network to guess."""
    z, y = np.meshgrid(np.linspace(-1.6, 1.6, 81), np.linspace(0.4, 0.9, 13))
    position = np.stack([np.full_like(z, 0.8), y, z], axis=-1)
    flank = shapes.Texels(position, np.broadcast_to([1.0, 0.0, 0.0], position.shape))
    layer = weather(vehicle, flank, RECIPES[name](amount=0.8, seed=1)).numpy()
    steps = np.abs(np.diff(layer, axis=1))
    assert np.sqrt(np.square(steps).mean()) < 0.06
    assert layer[..., 3].std() > 0.05
