"""The protocol: methods, capabilities, and clear errors for inputs that must be refused."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.errors import SvbrdfganError, UnsupportedError
from svbrdfgan.protocols import (
    DeferredRenderer,
    PullbackRenderer,
    Renderer,
    RendererCapabilities,
    TransportRenderer,
)
from svbrdfgan.testing import scenes
from svbrdfgan.testing.contract import PluginTests
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import Environment, Material, Materials, View
from svbrdfgan.types.material import CHANNELS

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
VIEW = scenes.front_view(scenes.random_light(), width=6, height=4)
ONES = torch.ones(4, 6, 3)
_OF_GRADIENTS = ("render_vjp", "render_pullback")
_OF_MATERIALS = ("render", *_OF_GRADIENTS)
_OF_STORED_LIGHT = ("store_light", "shade")
_LONGEST = 400


class ContractTests(PluginTests, RendererKit):
    """Protocol, capabilities, errors."""

    def test_it_is_a_renderer(self) -> None:
        """It has every member of `Renderer`, and its device is a torch.device."""
        check(isinstance(self.renderer, Renderer), f"{type(self.renderer).__name__} lacks a member of Renderer.")
        check(isinstance(self.renderer.device, torch.device), f"its device is {self.renderer.device!r}.")

    def test_methods_take_the_protocols_parameters(self) -> None:
        """Its methods take the protocol's parameters, by name and by kind."""
        methods: list[tuple[type, str]] = [(Renderer, "prepare"), (Renderer, "render"), (Renderer, "render_vjp")]
        methods += [(TransportRenderer, "transport")] if self.capabilities.transport else []
        methods += [(PullbackRenderer, "render_pullback")] if self.capabilities.pullback else []
        methods += [(DeferredRenderer, name) for name in _OF_STORED_LIGHT if self.capabilities.deferred]
        for protocol, name in methods:
            wanted = list(inspect.signature(getattr(protocol, name)).parameters.values())[1:]
            found = list(inspect.signature(getattr(self.renderer, name)).parameters.values())
            extra = [p.name for p in found[len(wanted) :] if p.default is p.empty]
            same = [(p.name, p.kind) for p in found[: len(wanted)]] == [(p.name, p.kind) for p in wanted]
            names = [f"{p.name}{' (keyword-only)' if p.kind is p.KEYWORD_ONLY else ''}" for p in wanted]
            check(same and not extra, f"{name} takes {[p.name for p in found]}; wanted {', '.join(names)}.")

    def test_capabilities_are_a_constant_record(self) -> None:
        """Its capabilities are a hashable record that does not change with use."""
        before = self.capabilities
        check(isinstance(before, RendererCapabilities), f"capabilities is a {type(before).__name__}.")
        self.render(scenes.plane(), WHITE, VIEW, spp=1)
        check(hash(before) == hash(self.capabilities) and before == self.capabilities, "capabilities change with use.")

    def test_capabilities_name_what_exists(self) -> None:
        """Its capabilities name known maps, and differentiate only what it reads."""
        maps, wrt, bounces = self.capabilities.maps, self.capabilities.differentiable, self.capabilities.max_bounces
        check("base_color" in maps, f"maps is {sorted(maps)}, without base_color, which every material has.")
        check(maps <= CHANNELS.keys(), f"maps names {sorted(maps - CHANNELS.keys())}; known are {list(CHANNELS)}.")
        check(wrt <= maps | {"environment"}, f"differentiable names {sorted(wrt - maps)}, which it does not read.")
        check(isinstance(bounces, int) and bounces >= 1, f"max_bounces is {bounces!r}; wanted 1 or more.")

    def test_transport_is_there_where_declared(self) -> None:
        """Declared `transport` yields samples; undeclared, it is absent or raises."""
        prepared = self.renderer.prepare(scenes.plane())
        if self._has_declared("transport", TransportRenderer, self.capabilities.transport):
            samples = list(_call(self.renderer, "transport", prepared)())
            check(bool(samples), "transport is declared, and yields nothing.")

    def test_pullback_is_there_where_declared(self) -> None:
        """Declared `render_pullback` exists; undeclared, it is absent or raises."""
        self._has_declared("render_pullback", PullbackRenderer, self.capabilities.pullback)

    def test_stored_light_is_there_where_declared(self) -> None:
        """Declared `store_light` and `shade` exist; undeclared, `store_light` is absent or raises."""
        self._has_declared("store_light", DeferredRenderer, self.capabilities.deferred)

    def test_maps_it_lacks_are_refused(self) -> None:
        """A material with a map that is not declared raises `UnsupportedError`."""
        lacking = sorted(CHANNELS.keys() - self.capabilities.maps)
        declared(bool(lacking), "lacking a map")
        for name in lacking:
            needed = {"roughness"} if name == "metallic" else set()  # without it, it is no material
            maps = {each: torch.full((CHANNELS[each],), 0.5) for each in ("base_color", name, *needed)}
            self._require_refused(UnsupportedError, name, *_OF_MATERIALS, materials=Materials((Material(maps),)))

    def test_gradients_it_lacks_are_refused(self) -> None:
        """`wrt` of something not differentiable raises `UnsupportedError`."""
        for name in sorted({*CHANNELS, "environment", "camera"} - self.capabilities.differentiable):
            self._require_refused(UnsupportedError, f"wrt = {{{name!r}}}", *_OF_GRADIENTS, wrt=frozenset({name}))

    def test_gradients_are_of_what_is_asked(self) -> None:
        """Gradients hold what `wrt` names, and nothing else."""
        prepared, known = self.renderer.prepare(scenes.plane()), self.capabilities.differentiable
        for wrt in (frozenset[str](), *(frozenset({name}) for name in sorted(known))):
            for name in self._having(*_OF_GRADIENTS):
                gradients = _call(self.renderer, name, prepared, wrt=wrt)()
                found, wanted = [set(part) for part in gradients.materials], [set(wrt & {"base_color"})]
                check(found == wanted, f"for wrt {sorted(wrt)}, {name}'s gradients hold {found}; wanted {wanted}.")
                light = "None" if gradients.environment is None else "given"
                right = (light == "given") == ("environment" in wrt)
                check(right, f"for wrt {sorted(wrt)}, {name}'s environment is {light}.")

    def test_wrong_numbers_of_materials_are_refused(self) -> None:
        """Materials that are not one for each part are refused in a sentence."""
        prepared = self.renderer.prepare(scenes.two_parts())
        for count in (1, 3):
            what, materials = f"{count} materials for 2 parts", Materials(WHITE.parts * count)
            self._require_refused(SvbrdfganError, what, *_OF_MATERIALS, prepared=prepared, materials=materials)

    def test_no_samples_are_refused(self) -> None:
        """`spp` below 1 is refused in a sentence, by transport too, and before its first sample is asked for."""
        for spp in (0, -1):
            self._require_refused(SvbrdfganError, f"spp {spp}", *_OF_MATERIALS, "transport", "store_light", spp=spp)

    def test_impossible_light_is_refused(self) -> None:
        """Radiance that is negative, infinite or not a number is refused in a sentence."""
        for value in (-1.0, torch.inf, torch.nan):
            radiance = scenes.random_light().radiance
            radiance[3, 4, 1] = value
            view = scenes.front_view(Environment(radiance), width=6, height=4)
            methods = *_OF_MATERIALS, "transport", "store_light"
            self._require_refused(SvbrdfganError, f"a radiance of {value}", *methods, view=view)

    def test_gradients_of_another_film_are_refused(self) -> None:
        """`grad_image` of another shape than the film is refused in a sentence."""
        declared(bool(self.capabilities.differentiable), "a gradient")
        wrt = frozenset(sorted(self.capabilities.differentiable)[:1])
        for shape in ((6, 4, 3), (4, 6, 1), (1, 4, 6, 3)):
            what = f"grad_image of shape {shape} for a film of 4 x 6"
            self._require_refused(SvbrdfganError, what, *_OF_GRADIENTS, wrt=wrt, grad_image=torch.ones(shape))

    def _has_declared(self, name: str, protocol: type, given: bool) -> bool:
        """Whether the method is declared; fails if it is missing, or can be called undeclared."""
        if given:
            check(isinstance(self.renderer, protocol), f"{name} is declared, and there is no such method.")
        elif hasattr(self.renderer, name):
            call = _call(self.renderer, name, self.renderer.prepare(scenes.plane()))
            require_refused(UnsupportedError, f"{name}, which is not declared,", call)
        return given

    def _require_refused(
        self, wanted: type[SvbrdfganError], what: str, *names: str, prepared: Any = None, **inputs: Any
    ) -> None:
        prepared = self.renderer.prepare(scenes.plane()) if prepared is None else prepared
        for name in self._having(*names):
            require_refused(wanted, f"{name} with {what}", _call(self.renderer, name, prepared, **inputs))

    def _having(self, *names: str) -> list[str]:
        """Those of the methods that the renderer has."""
        optional = {
            "render_pullback": self.capabilities.pullback,
            "transport": self.capabilities.transport,
            "store_light": self.capabilities.deferred,
        }
        return [name for name in names if optional.get(name, True)]

    def test_two_renderers_are_independent(self) -> None:
        """A second renderer, used in between, changes nothing of the first."""
        first, prepared = self.renderer, self.renderer.prepare(scenes.sphere())
        before = first.render(prepared, WHITE, VIEW, spp=2, seed=1).image
        second = self.make_renderer()
        second.render(second.prepare(scenes.plane()), scenes.lambertian(scenes.RED), VIEW, spp=2, seed=1)
        del second
        after = first.render(prepared, WHITE, VIEW, spp=2, seed=1).image
        check(torch.equal(before, after), "the same picture differs after another renderer was made and used.")


def _call(
    renderer: Any,
    name: str,
    prepared: Any,
    *,
    materials: Materials = WHITE,
    view: View = VIEW,
    wrt: frozenset[str] | None = None,
    spp: int = 1,
    grad_image: Tensor = ONES,
) -> Callable[[], Any]:
    """A call of a protocol's method with these inputs; of a pullback, it asks for the gradient."""
    wrt = frozenset({"base_color"}) & renderer.capabilities.differentiable if wrt is None else wrt
    scene, chance = (prepared, materials, view), {"spp": spp, "seed": 0}
    found: dict[str, Callable[[], Any]] = {
        "render": lambda: renderer.render(*scene, **chance),
        "render_vjp": lambda: renderer.render_vjp(*scene, grad_image, wrt=wrt, **chance),
        "render_pullback": lambda: renderer.render_pullback(*scene, wrt=wrt, **chance)[1](grad_image),
        "transport": lambda: renderer.transport(prepared, view, **chance),
        "store_light": lambda: renderer.store_light(prepared, view, learnable=(0,), hits=1, **chance),
    }
    return found[name]


def require_refused(wanted: type[SvbrdfganError], what: str, call: Callable[[], object]) -> None:
    """Fails unless the call raises that error, with a message that a user can read."""
    try:
        call()
    except wanted as error:
        text = str(error)
        sentence = "\n" not in text and 10 < len(text) <= _LONGEST and text.endswith(".")
        check(sentence, f"{what}: the message should be one sentence of at most {_LONGEST} characters; it is {text!r}.")
    except Exception as error:
        raise AssertionError(f"{what} raised {type(error).__name__} ({error}); wanted {wanted.__name__}.") from error
    else:
        raise AssertionError(f"{what} was accepted; wanted {wanted.__name__}.")
