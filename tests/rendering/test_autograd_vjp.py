"""`autograd_vjp`: gradients of a differentiable picture, apart from the caller's tensors and graph."""

import pytest
import torch

from svbrdfgan.rendering.autograd_vjp import autograd_vjp
from svbrdfgan.testing import scenes
from svbrdfgan.types import Material, Materials, View

VIEW = scenes.front_view(scenes.random_light(2, 3), width=3, height=2)
COLORS = scenes.lambertian(scenes.random_texture(2, 3), (0.2, 0.3, 0.4))
COTANGENT = torch.arange(18.0).reshape(2, 3, 3)


def product(materials: Materials, view: View) -> torch.Tensor:
    """A picture that is the light times the first colour; the second one is not seen."""
    return view.environment.radiance * materials[0].base_color.double()


def test_the_gradient_is_that_of_the_product() -> None:
    found = autograd_vjp(product, COLORS, VIEW, COTANGENT, wrt=frozenset({"base_color", "environment"}))
    light, color = VIEW.environment.radiance, COLORS[0].base_color
    torch.testing.assert_close(found.materials[0]["base_color"], COTANGENT * light)
    torch.testing.assert_close(found.environment, COTANGENT * color)
    assert torch.equal(found.materials[1]["base_color"], torch.zeros(3))


@pytest.mark.parametrize("wrt", [frozenset(), frozenset({"base_color"}), frozenset({"environment"})])
def test_the_gradient_has_what_is_asked_alone(wrt: frozenset[str]) -> None:
    with torch.no_grad():
        found = autograd_vjp(product, COLORS, VIEW, COTANGENT, wrt=wrt)
    assert [set(part) for part in found.materials] == [set(wrt & {"base_color"})] * 2
    assert (found.environment is not None) == ("environment" in wrt)


def test_the_caller_s_graph_is_left_alone() -> None:
    texture = scenes.random_texture(2, 3).requires_grad_()
    given = scenes.lambertian(texture * 1.0, (0.2, 0.3, 0.4))
    found = autograd_vjp(product, given, VIEW, COTANGENT, wrt=frozenset({"base_color"}))
    assert texture.grad is None
    assert not found.materials[0]["base_color"].requires_grad


def test_a_picture_that_depends_on_nothing_has_a_gradient_of_zero() -> None:
    found = autograd_vjp(lambda m, v: torch.ones(2, 3, 3), COLORS, VIEW, COTANGENT, wrt=frozenset({"base_color"}))
    assert not found.materials[0]["base_color"].any()


def test_gradients_are_single_precision_whatever_the_inputs() -> None:
    given = scenes.lambertian(scenes.random_texture(2, 3), (0.2, 0.3, 0.4))
    double = Materials(tuple(Material({"base_color": part.base_color.double()}) for part in given.parts))
    found = autograd_vjp(product, double, VIEW, COTANGENT, wrt=frozenset({"base_color", "environment"}))
    gradients = (*(part["base_color"] for part in found.materials), found.environment)
    assert {gradient.dtype for gradient in gradients} == {torch.float32}
