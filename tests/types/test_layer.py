"""Layers: each map is where its name says, and nothing is guessed from a number of channels."""

from __future__ import annotations

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.types import FURTHER_MAPS, Layer, channel_slices, layer_channels

SETS = [(), ("roughness",), ("roughness", "metallic"), ("normal",), ("roughness", "normal"), FURTHER_MAPS]


@pytest.mark.parametrize("maps", SETS)
def test_the_slices_of_the_maps_are_all_channels_in_their_order(maps: tuple[str, ...]) -> None:
    slices = channel_slices(maps)
    assert tuple(slices) == ("base_color", "alpha", *maps)
    assert [n for place in slices.values() for n in range(place.start, place.stop)] == list(range(layer_channels(maps)))


def test_maps_are_found_by_name() -> None:
    layer = Layer(torch.arange(9.0).expand(2, 3, 9), ("roughness", "metallic", "normal"))
    assert layer.base_color[0, 0].tolist() == [0, 1, 2]
    assert layer.rgba[0, 0].tolist() == [0, 1, 2, 3]
    assert layer.alpha.shape == (2, 3)
    assert layer["alpha"][0, 0].tolist() == [3] == [layer.alpha[0, 0]]
    assert layer["roughness"][0, 0].tolist() == [4]
    assert layer["metallic"][0, 0].tolist() == [5]
    assert layer["normal"][0, 0].tolist() == [6, 7, 8]
    assert layer.further[0, 0].tolist() == [4, 5, 6, 7, 8]
    with pytest.raises(KeyError, match="normal"):
        Layer(layer.rgba)["normal"]


@pytest.mark.parametrize("shape", [(), (2,), (5, 2, 3)])
def test_any_axes_lead(shape: tuple[int, ...]) -> None:
    layer = Layer(torch.rand(*shape, 5), ("roughness",))
    assert layer.alpha.shape == shape
    assert layer["roughness"].shape == (*shape, 1)


def test_maps_are_views_with_gradients() -> None:
    layer = Layer(torch.rand(2, 3, 5, requires_grad=True), ("roughness",))
    layer["roughness"].sum().backward()
    assert layer.values.grad is not None
    assert layer.values.grad.sum(dim=(0, 1)).tolist() == [0, 0, 0, 0, 6]


@pytest.mark.parametrize("channels", [4, 6])
def test_channels_for_other_maps_are_refused(channels: int) -> None:
    said = f"a layer has {channels} channels; wanted 5, for base_color, roughness and alpha"
    with pytest.raises(AssetError, match=said):
        Layer(torch.rand(2, 2, channels), ("roughness",))


@pytest.mark.parametrize("maps", [("metallic", "roughness"), ("roughness", "roughness"), ("gloss",), ("base_color",)])
def test_maps_in_another_order_or_of_unknown_names_are_refused(maps: tuple[str, ...]) -> None:
    with pytest.raises(AssetError, match=r"wanted some of .*, each once and in this order"):
        Layer(torch.rand(2, 2, 6), maps)


def test_a_layer_moves_to_a_device_with_its_maps() -> None:
    moved = Layer(torch.rand(2, 2, 5), ("roughness",)).to("meta")
    assert (moved.values.device.type, moved.maps) == ("meta", ("roughness",))
