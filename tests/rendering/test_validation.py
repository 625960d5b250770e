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


def test_what_is_stored_needs_hits_and_parts_that_exist() -> None:
    able = RendererCapabilities(deferred=True)
    parts = ["body", "wheel"]
    validation.check_store_light("mine", able, parts, (1, 0), hits=1, spp=1)
    with pytest.raises(UnsupportedError, match="mine renderer: it stores no light"):
        validation.check_store_light("mine", DIRECT, parts, (0,), hits=1, spp=1)
    with pytest.raises(ConfigError, match="hits is 0; wanted at least 1 for each pixel"):
        validation.check_store_light("mine", able, parts, (0,), hits=0, spp=1)
    for learnable in ((0, 0), (2,), (-1,)):
        with pytest.raises(ConfigError, match="wanted numbers of parts from 0 to 1, each at most once"):
            validation.check_store_light("mine", able, parts, learnable, hits=1, spp=1)


ABLE = RendererCapabilities(maps=frozenset({"base_color", "roughness", "metallic"}), deferred=True)
VIEW = (4, 6), 2


@pytest.mark.parametrize(
    ("views", "shape", "maps", "visit", "message"),
    [
        ([], (0, 1, 1, 3), ("base_color",), 0, "shade got no stored light; wanted that of one view or more"),
        ([VIEW, ((4, 5), 2)], (4, 1, 1, 3), ("base_color",), 0, "views of 4 x 5, 4 x 6 pixels (height x width)"),
        ([VIEW], (2, 1, 1, 3), ("base_color",), -1, "visit is -1; wanted 0 or more"),
        ([VIEW], (2, 1, 1, 6), ("base_color", "normal"), 0, "maps names normal, but the renderer reads only"),
        ([VIEW], (2, 1, 1, 0), (), 0, "maps is empty; wanted base_color, then each further map once"),
        ([VIEW], (2, 1, 1, 4), ("roughness", "base_color"), 0, "maps is roughness, base_color; wanted base_color"),
        ([VIEW], (2, 1, 1, 4), ("base_color", "metallic"), 0, "metallic without roughness; wanted both or neither"),
        ([VIEW], (1, 8, 8, 3), ("base_color",), 0, "shape (1, 8, 8, 3); wanted (2, rows, cols, 3): one for each"),
        ([VIEW], (2, 8, 8, 3), ("base_color", "roughness"), 0, "wanted (2, rows, cols, 4): one for each learnable"),
    ],
)
def test_what_is_shaded_fits_the_views(
    views: list[tuple[tuple[int, int], int]], shape: tuple[int, ...], maps: tuple[str, ...], visit: int, message: str
) -> None:
    with pytest.raises((ConfigError, UnsupportedError), match=re.escape(message)):
        validation.check_shade("mine", ABLE, views, torch.zeros(shape), maps, visit=visit)
    validation.check_shade("mine", ABLE, [VIEW], torch.zeros(2, 8, 8, 4), ("base_color", "roughness"), visit=0)


def test_the_gradient_of_shaded_pictures_has_their_shape() -> None:
    validation.check_cotangents("mine", (2, 4, 6, 3), torch.zeros(2, 4, 6, 3))
    with pytest.raises(ConfigError, match=re.escape("gradient has shape (4, 6, 3); wanted (2, 4, 6, 3)")):
        validation.check_cotangents("mine", (2, 4, 6, 3), torch.zeros(4, 6, 3))
