"""Layers over materials, and images over backgrounds."""

from __future__ import annotations

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.rendering.compositing import bare_maps, composite, composite_maps, composite_values, over
from svbrdfgan.types import Layer


def test_clear_shows_the_base_and_opaque_the_layer() -> None:
    base, color = torch.rand(4, 5, 3), torch.rand(4, 5, 3)
    clear, opaque = (Layer(torch.cat([color, torch.full((4, 5, 1), alpha)], dim=-1)) for alpha in (0.0, 1.0))
    assert torch.equal(composite(base, clear), base)
    torch.testing.assert_close(composite(base, opaque), color, atol=1e-7, rtol=0)


def test_straight_alpha_mixes_linearly() -> None:
    mixed = composite(torch.tensor([1.0, 0.0, 0.5]), Layer(torch.tensor([0.0, 1.0, 0.5, 0.25])))
    torch.testing.assert_close(mixed, torch.tensor([0.75, 0.25, 0.5]))


def test_a_constant_base_broadcasts() -> None:
    base, layer = torch.rand(3), Layer(torch.rand(2, 4, 5, 4))
    assert torch.equal(composite(base, layer), composite(base.expand(2, 4, 5, 3), layer))


def test_two_layers_are_one_of_their_union() -> None:
    """Porter and Duff's over: a2 + a1 (1 - a2)."""
    base, first, second = torch.rand(3), torch.rand(4), torch.rand(4)
    alpha = second[3] + first[3] * (1 - second[3])
    color = (second[:3] * second[3] + first[:3] * first[3] * (1 - second[3])) / alpha
    union = Layer(torch.cat([color, alpha[None]]))
    torch.testing.assert_close(composite(composite(base, Layer(first)), Layer(second)), composite(base, union))


def test_composite_is_differentiable() -> None:
    inputs = [torch.rand(2, 3, 3).double().requires_grad_(True), torch.rand(2, 3, 4).double().requires_grad_(True)]
    assert torch.autograd.gradcheck(lambda base, values: composite(base, Layer(values)), inputs)


def test_an_opaque_layer_is_its_own_maps_whatever_their_order() -> None:
    layer = Layer(torch.rand(4, 5, 6), ("roughness", "metallic"))
    layer["alpha"][:] = 1
    base = {"metallic": torch.rand(1), "base_color": torch.rand(3), "roughness": torch.rand(1)}
    made = composite_maps(base, layer)
    for name in base:
        torch.testing.assert_close(made[name], layer[name], atol=1e-7, rtol=0)


def test_every_map_is_mixed_by_the_one_alpha() -> None:
    base = {"base_color": torch.rand(3), "roughness": torch.rand(1)}
    layer = Layer(torch.rand(2, 2, 5), ("roughness",))
    made = composite_maps(base, layer)
    stacked = composite_values(torch.cat([base["base_color"], base["roughness"]]), layer)
    torch.testing.assert_close(torch.cat([made["base_color"], made["roughness"]], dim=-1), stacked)
    torch.testing.assert_close(made["base_color"], composite(base["base_color"], layer))
    expected = base["roughness"] * (1 - layer["alpha"]) + layer["roughness"] * layer["alpha"]
    torch.testing.assert_close(made["roughness"], expected)


def test_maps_that_the_layer_does_not_paint_stay_bare() -> None:
    base = {"base_color": torch.rand(3), "metallic": torch.rand(1), "roughness": torch.rand(1), "normal": torch.rand(3)}
    layer = Layer(torch.rand(2, 2, 8), ("roughness", "normal"))
    made = composite_maps(base, layer)
    assert made.keys() == base.keys()
    assert made["metallic"] is base["metallic"]
    painted = composite_maps({name: base[name] for name in ("base_color", "roughness", "normal")}, layer)
    assert all(torch.equal(made[name], painted[name]) for name in painted)
    assert composite_maps(base, Layer(layer.rgba))["normal"] is base["normal"]


def test_a_layer_that_paints_what_is_not_there_is_refused() -> None:
    with pytest.raises(AssetError, match="a layer paints roughness, which the material under it does not have"):
        composite_maps({"base_color": torch.rand(3)}, Layer(torch.rand(2, 2, 5), ("roughness",)))


def test_under_a_layer_normals_are_flat() -> None:
    bare = bare_maps({"roughness": 0.25, "metallic": 1.0, "normal": 0.0})
    assert {name: values.tolist() for name, values in bare.items()} == {
        "roughness": [0.25],
        "metallic": [1.0],
        "normal": [0.0, 0.0, 1.0],
    }


def test_over_shows_the_background_where_nothing_covers() -> None:
    image, background = torch.rand(4, 5, 3), torch.rand(3)
    covered, bare = torch.ones(4, 5), torch.zeros(4, 5)
    assert torch.equal(over(image, covered, background), image)
    torch.testing.assert_close(over(torch.zeros(4, 5, 3), bare, background), background.expand(4, 5, 3))


def test_over_leaves_radiance_above_one_alone() -> None:
    image = torch.full((1, 1, 3), 40.0)
    torch.testing.assert_close(over(image, torch.tensor([[0.5]]), torch.ones(3)), torch.full((1, 1, 3), 40.5))
