"""The core's door to renderers: what it refuses never reaches a plugin, and each message is one sentence."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest
import torch
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError, SvbrdfganError, UnsupportedError
from svbrdfgan.protocols import Renderer, RendererCapabilities
from svbrdfgan.rendering.checked_renderer import CheckedRenderer, PreparedSurface, checked
from svbrdfgan.testing import scenes
from svbrdfgan.types import Environment, Gradients, Material, Materials, Rendering

ABLE = RendererCapabilities(transport=True, pullback=True, deferred=True)
WHITE = scenes.lambertian((1.0, 1.0, 1.0))
VIEW = scenes.front_view(scenes.random_light(), width=6, height=4)
ONES = torch.ones(4, 6, 3)
COLOR = frozenset({"base_color"})
SAMPLED = {"spp": 1, "seed": 0}
WITH_MATERIALS = ("render", "render_vjp", "render_pullback")
WITH_LIGHT = (*WITH_MATERIALS, "transport", "store_light")


@dataclass(frozen=True)
class Black:
    """A plugin of black pictures that checks nothing. `called` has the names of its methods that were reached."""

    capabilities: RendererCapabilities = ABLE
    called: tuple[str, ...] = ()

    @property
    def device(self) -> torch.device:
        return torch.device("cpu")

    def prepare(self, surface: Any) -> str:
        return "ready"

    def render(self, *given: Any, **named: Any) -> Rendering:
        return Rendering(self._reached("render", 0 * ONES), ONES[..., 0])

    def render_vjp(self, *given: Any, **named: Any) -> Gradients:
        return self._reached("render_vjp", Gradients(({},)))

    def render_pullback(self, *given: Any, **named: Any) -> tuple[Rendering, Callable[[Tensor], Gradients]]:
        return self.render(), lambda grad_image: self.render_vjp(grad_image)

    def transport(self, *given: Any, **named: Any) -> Any:
        return self._reached("transport", iter(()))

    def store_light(self, *given: Any, **named: Any) -> Any:
        return self._reached("store_light", ONES)

    def shade(self, *given: Any, **named: Any) -> Any:
        return self._reached("shade", ONES[None]), lambda grad: self._reached("unshade", grad)

    def _reached(self, name: str, result: Any) -> Any:
        object.__setattr__(self, "called", (*self.called, name))
        return result


@pytest.fixture
def renderer() -> CheckedRenderer:
    return CheckedRenderer(Black(), "mine")


def call(renderer: CheckedRenderer, method: str, **changed: Any) -> object:
    """Calls one method with good arguments but for those that are given."""
    given = {"materials": WHITE, "view": VIEW, "grad_image": ONES, "wrt": COLOR, **SAMPLED, **changed}
    grad_image, wrt = given["grad_image"], given["wrt"]
    surface = given.get("prepared") or renderer.prepare(given.get("surface", scenes.plane()))
    scene, sampled = (surface, given["materials"], given["view"]), {name: given[name] for name in SAMPLED}
    calls: dict[str, Callable[[], object]] = {
        "render": lambda: renderer.render(*scene, **sampled),
        "render_vjp": lambda: renderer.render_vjp(*scene, grad_image, wrt=wrt, **sampled),
        "render_pullback": lambda: renderer.render_pullback(*scene, wrt=given["wrt"], **sampled)[1](
            given["grad_image"]
        ),
        "transport": lambda: renderer.transport(surface, given["view"], **sampled),
        "store_light": lambda: renderer.store_light(
            surface, given["view"], learnable=given.get("learnable", (0,)), hits=given.get("hits", 1), **sampled
        ),
    }
    return calls[method]()


def refused(
    renderer: CheckedRenderer, methods: tuple[str, ...], kind: type[SvbrdfganError], message: str, **changed: Any
) -> None:
    """Each of these methods raises one sentence, and none reaches the plugin."""
    for method in methods:
        with pytest.raises(kind, match=message) as caught:
            call(renderer, method, **changed)
        assert "\n" not in str(caught.value)
        assert str(caught.value).endswith(".")
    assert isinstance(renderer.plugin, Black)
    assert renderer.plugin.called == ()


@pytest.mark.parametrize("method", WITH_LIGHT)
def test_good_arguments_reach_the_plugin(renderer: CheckedRenderer, method: str) -> None:
    call(renderer, method)
    assert isinstance(renderer.plugin, Black)
    assert renderer.plugin.called


@pytest.mark.parametrize("spp", [0, -1])
def test_a_picture_needs_samples(renderer: CheckedRenderer, spp: int) -> None:
    """Also of transport, and before its first sample is asked for."""
    refused(renderer, WITH_LIGHT, ConfigError, f"mine renderer: spp is {spp}; wanted at least 1", spp=spp)


@pytest.mark.parametrize("count", [1, 3])
def test_each_part_needs_a_material(renderer: CheckedRenderer, count: int) -> None:
    message = f"got {count} materials for a surface of 2 parts"
    given = Materials(WHITE.parts * count)
    refused(renderer, WITH_MATERIALS, ConfigError, message, surface=scenes.two_parts(), materials=given)


def test_maps_that_are_not_read_are_refused(renderer: CheckedRenderer) -> None:
    rough = Materials((Material({"base_color": torch.ones(3), "roughness": torch.ones(1)}),))
    refused(renderer, WITH_MATERIALS, UnsupportedError, "has roughness, but the renderer reads only", materials=rough)


@pytest.mark.parametrize("name", ["environment", "camera", "roughness"])
def test_gradients_that_are_not_declared_are_refused(renderer: CheckedRenderer, name: str) -> None:
    message = f"no gradient for {name}, only for base_color"
    refused(renderer, WITH_MATERIALS[1:], UnsupportedError, message, wrt=frozenset({name}))
    with pytest.raises(UnsupportedError, match=message):
        renderer.require_differentiable(frozenset({name}))


@pytest.mark.parametrize("value", [-1e-6, torch.inf, torch.nan])
def test_light_is_finite_and_not_negative(renderer: CheckedRenderer, value: float) -> None:
    radiance = scenes.random_light().radiance
    radiance[3, 4, 1] = value
    view = scenes.front_view(Environment(radiance), width=6, height=4)
    refused(renderer, WITH_LIGHT, AssetError, "negative or not finite", view=view)


@pytest.mark.parametrize("shape", [(6, 4, 3), (4, 6, 1), (1, 4, 6, 3)])
def test_a_gradient_is_of_the_film(renderer: CheckedRenderer, shape: tuple[int, ...]) -> None:
    refused(renderer, ("render_vjp",), ConfigError, r"wanted \(4, 6, 3\)", grad_image=torch.ones(shape))
    with pytest.raises(ConfigError, match=r"wanted \(4, 6, 3\)"):
        call(renderer, "render_pullback", grad_image=torch.ones(shape))


@pytest.mark.parametrize(("power", "method"), [("pullback", 2), ("transport", 3), ("deferred", 4)])
def test_what_is_not_declared_is_not_called(power: str, method: int) -> None:
    """Though the plugin has such a method."""
    without = CheckedRenderer(Black(replace(ABLE, **{power: False})), "mine")
    refused(without, (WITH_LIGHT[method],), UnsupportedError, "mine renderer: it has no ")
    if power == "deferred":
        with pytest.raises(UnsupportedError, match="it has no stored light"):
            without.shade([], ONES[None], maps=("base_color",), visit=0, seed=0)


def test_what_is_stored_needs_hits_and_parts_that_exist(renderer: CheckedRenderer) -> None:
    refused(renderer, ("store_light",), ConfigError, "hits is 0; wanted at least 1 for each pixel", hits=0)
    for learnable in ((0, 0), (2,), (-1,)):
        message = "wanted numbers of parts from 0 to 1, each at most once"
        refused(renderer, ("store_light",), ConfigError, message, surface=scenes.two_parts(), learnable=learnable)


def test_shaded_pictures_and_their_gradient_fit_the_views(renderer: CheckedRenderer) -> None:
    light: Any = call(renderer, "store_light")
    assert (light.film, light.learnable, light.nbytes) == ((4, 6), 1, ONES.nbytes)
    with pytest.raises(ConfigError, match=r"textures have shape \(2, 4, 6, 3\); wanted \(1, rows, cols, 3\)"):
        renderer.shade([light], torch.ones(2, 4, 6, 3), maps=("base_color",), visit=0, seed=0)
    _, pullback = renderer.shade([light], ONES[None], maps=("base_color",), visit=0, seed=0)
    with pytest.raises(ConfigError, match=r"gradient has shape \(4, 6, 3\); wanted \(1, 4, 6, 3\)"):
        pullback(ONES)
    assert torch.equal(pullback(ONES[None]), ONES[None])


def test_a_surface_stays_with_its_renderer_and_device(renderer: CheckedRenderer) -> None:
    elsewhere = renderer.prepare(scenes.plane())
    for given, message in (
        (
            replace(elsewhere, device=torch.device("cuda", 0)),
            "prepared by mine on cuda:0; prepare it again by mine on cpu",
        ),
        (replace(elsewhere, renderer="other"), "prepared by other on cpu"),
        ("ready", "the surface is a str; wanted what this renderer's own prepare returns"),
    ):
        refused(renderer, WITH_LIGHT, ConfigError, message, prepared=given)
    light = replace(call(renderer, "store_light"), surface=replace(elsewhere, renderer="other"))  # type: ignore[type-var]
    with pytest.raises(ConfigError, match="prepared by other"):
        renderer.shade([light], ONES[None], maps=("base_color",), visit=0, seed=0)  # type: ignore[list-item]


def test_a_checked_renderer_is_a_renderer_that_pickles(renderer: CheckedRenderer) -> None:
    assert isinstance(renderer, Renderer)
    assert pickle.loads(pickle.dumps(renderer)) == renderer
    assert checked(renderer) is renderer
    assert checked(renderer.plugin) == CheckedRenderer(renderer.plugin, "Black")
    assert isinstance(renderer.prepare(scenes.two_parts()), PreparedSurface)
    assert renderer.prepare(scenes.two_parts()).parts == tuple(part.name for part in scenes.two_parts().parts)
