"""The arguments that every renderer rejects, and the messages."""

import re

import pytest
import torch

from svbrdfgan.errors import AssetError, ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.rendering import validation
from svbrdfgan.testing import scenes
from svbrdfgan.types import Material, Materials

DIRECT = RendererCapabilities(transport=True)
WHITE = scenes.lambertian((1.0, 1.0, 1.0))


def test_valid_arguments_pass() -> None:
    validation.check_render("mine", DIRECT, ["body"], WHITE, spp=1, wrt={"base_color"})
    validation.check_transport("mine", DIRECT, spp=1)
    validation.check_cotangent(
        "mine", scenes.front_view(scenes.constant_light(), width=3, height=2), torch.ones(2, 3, 3)
    )
    validation.check_radiance(torch.zeros(2, 4, 3, requires_grad=True))
    validation.check_device("mine", torch.device("cpu"), torch.device("cpu"))


def test_a_picture_needs_samples_and_a_material_for_each_part() -> None:
    with pytest.raises(ConfigError, match="mine renderer: spp is 0; wanted at least 1"):
        validation.check_render("mine", DIRECT, ["body"], WHITE, spp=0)
    with pytest.raises(ConfigError, match="got 1 materials for a surface of 2 parts"):
        validation.check_render("mine", DIRECT, ["body", "wheel"], WHITE, spp=1)


def test_what_is_not_declared_is_unsupported() -> None:
    rough = Materials((Material({"base_color": torch.ones(3), "roughness": torch.ones(1)}),))
    with pytest.raises(UnsupportedError, match="part 'body' has roughness, but the renderer reads only base_color"):
        validation.check_render("mine", DIRECT, ["body"], rough, spp=1)
    with pytest.raises(UnsupportedError, match="no gradient for environment; wrt may name base_color"):
        validation.check_render("mine", DIRECT, ["body"], WHITE, spp=1, wrt={"environment"})
    with pytest.raises(UnsupportedError, match="no transport where max_bounces is 3"):
        validation.check_transport("mine", RendererCapabilities(max_bounces=3), spp=1)


def test_a_gradient_is_of_the_film() -> None:
    view = scenes.front_view(scenes.constant_light(), width=3, height=2)
    with pytest.raises(ConfigError, match=re.escape("grad_image has shape (3, 2, 3); wanted (2, 3, 3)")):
        validation.check_cotangent("mine", view, torch.ones(3, 2, 3))


@pytest.mark.parametrize("value", [-1e-6, torch.inf, torch.nan])
def test_light_is_finite_and_not_negative(value: float) -> None:
    radiance = torch.ones(4, 8, 3)
    radiance[1, 2, 0] = value
    with pytest.raises(AssetError, match="negative or not finite"):
        validation.check_radiance(radiance)


def test_a_surface_stays_on_its_device() -> None:
    with pytest.raises(ConfigError, match="prepared on cpu; prepare it again for cuda:0"):
        validation.check_device("mine", torch.device("cpu"), torch.device("cuda", 0))
