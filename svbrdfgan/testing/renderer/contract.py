"""The protocol itself: found, typed, honest about its powers, and clear about what it refuses."""

from __future__ import annotations

import inspect
import pickle
from collections.abc import Callable
from functools import partial
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.errors import SvbrdfganError, UnsupportedError
from svbrdfgan.plugins import RENDERERS, find_plugin, import_factory, make
from svbrdfgan.protocols import PullbackRenderer, Renderer, RendererCapabilities, TransportRenderer
from svbrdfgan.testing import scenes
from svbrdfgan.testing.kit import check, declared
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import Gradients, Material, Materials, Rendering
from svbrdfgan.types.material import CHANNELS

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
VIEW = scenes.front_view(scenes.random_light(), width=6, height=4)
ONES = torch.ones(4, 6, 3)
_LONGEST = 400


class ContractTests(RendererKit):
    """Protocol, capabilities, options, refusals, pickles."""

    def test_its_entry_point_finds_it(self) -> None:
        """Its entry point's name leads to it, and its defaults suffice."""
        installed = type(self).make_renderer is RendererKit.make_renderer
        declared(installed and bool(self.name), "an entry point")
        plugin = find_plugin(RENDERERS, self.name)
        check(isinstance(make(plugin), Renderer), f"{plugin.title} makes no svbrdfgan.protocols.Renderer.")

    def test_it_is_a_renderer(self) -> None:
        """It has every member of `Renderer`, and its device is a torch.device."""
        check(isinstance(self.renderer, Renderer), f"{type(self.renderer).__name__} lacks a member of Renderer.")
        check(isinstance(self.renderer.device, torch.device), f"its device is {self.renderer.device!r}.")

    def test_methods_take_the_protocols_parameters(self) -> None:
        """Its methods take the protocol's parameters, by name and by kind."""
        powers: list[tuple[type, str]] = [(Renderer, "prepare"), (Renderer, "render"), (Renderer, "render_vjp")]
        powers += [(TransportRenderer, "transport")] if self.capabilities.transport else []
        powers += [(PullbackRenderer, "render_pullback")] if self.capabilities.pullback else []
        for protocol, name in powers:
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
        """Declared `transport` yields samples; undeclared, it is not to be had."""
        method: Callable[..., Any] | None = getattr(self.renderer, "transport", None)
        prepared = self.renderer.prepare(scenes.plane())
        if self.capabilities.transport:
            check(isinstance(self.renderer, TransportRenderer), "transport is declared, and there is no such method.")
            assert method is not None
            check(bool(list(method(prepared, VIEW, spp=1, seed=0))), "transport is declared, and yields nothing.")
        elif method is not None:
            samples = partial(method, prepared, VIEW, spp=1, seed=0)
            _refused(UnsupportedError, "transport, which is not declared", lambda: list(samples()))

    def test_options_have_types_and_defaults(self) -> None:
        """Its constructor's parameters are named, annotated, and have defaults."""
        installed = type(self).make_renderer is RendererKit.make_renderer and bool(self.name)
        factory = import_factory(find_plugin(RENDERERS, self.name)) if installed else type(self.renderer)
        for option in inspect.signature(factory).parameters.values():
            plain = option.kind in (option.POSITIONAL_OR_KEYWORD, option.KEYWORD_ONLY)
            check(plain, f"its constructor takes {option}; wanted only named options, so that a typing error is found.")
            check(option.annotation is not option.empty, f"its option {option.name!r} has no type.")
            check(option.default is not option.empty, f"its option {option.name!r} has no default.")

    def test_maps_it_lacks_are_refused(self) -> None:
        """A material with a map that is not declared raises `UnsupportedError`."""
        lacking = sorted(CHANNELS.keys() - self.capabilities.maps)
        declared(bool(lacking), "lacking a map")
        prepared, wrt = (
            self.renderer.prepare(scenes.plane()),
            frozenset({"base_color"}) & self.capabilities.differentiable,
        )
        for name in lacking:
            maps = {"base_color": torch.ones(3), name: torch.full((CHANNELS[name],), 0.5)}
            materials = Materials((Material(maps),))
            _refused(UnsupportedError, f"render with {name}", _render(self.renderer, prepared, materials))
            _refused(UnsupportedError, f"render_vjp with {name}", _vjp(self.renderer, prepared, wrt, materials))

    def test_gradients_it_lacks_are_refused(self) -> None:
        """`wrt` of something not differentiable raises `UnsupportedError`."""
        prepared = self.renderer.prepare(scenes.plane())
        for name in sorted({*CHANNELS, "environment", "camera"} - self.capabilities.differentiable):
            _refused(UnsupportedError, f"wrt = {{{name!r}}}", _vjp(self.renderer, prepared, frozenset({name})))

    def test_gradients_are_of_what_is_asked(self) -> None:
        """Gradients hold what `wrt` names, and nothing else."""
        prepared, powers = self.renderer.prepare(scenes.plane()), self.capabilities.differentiable
        for wrt in (frozenset[str](), *(frozenset({name}) for name in sorted(powers))):
            gradients = _vjp(self.renderer, prepared, wrt)()
            found, wanted = [set(part) for part in gradients.materials], [set(wrt & {"base_color"})]
            check(found == wanted, f"for wrt {sorted(wrt)}, gradients hold {found}; wanted {wanted}.")
            light = gradients.environment is not None
            check(
                light == ("environment" in wrt),
                f"for wrt {sorted(wrt)}, environment is {'given' if light else 'None'}.",
            )

    def test_wrong_numbers_of_materials_are_refused(self) -> None:
        """Materials that are not one for each part are refused in a sentence."""
        prepared = self.renderer.prepare(scenes.two_parts())
        for count in (1, 3):
            call = _render(self.renderer, prepared, Materials(WHITE.parts * count))
            _refused(SvbrdfganError, f"{count} materials for 2 parts", call)

    def test_no_samples_are_refused(self) -> None:
        """`spp` below 1 is refused in a sentence."""
        prepared = self.renderer.prepare(scenes.plane())
        for spp in (0, -1):
            _refused(SvbrdfganError, f"spp {spp}", _render(self.renderer, prepared, WHITE, spp))

    def test_gradients_of_another_film_are_refused(self) -> None:
        """`grad_image` of another shape than the film is refused in a sentence."""
        declared(bool(self.capabilities.differentiable), "a gradient")
        prepared, wrt = self.renderer.prepare(scenes.plane()), frozenset(sorted(self.capabilities.differentiable)[:1])
        for shape in ((6, 4, 3), (4, 6, 1), (1, 4, 6, 3)):
            call = _vjp(self.renderer, prepared, wrt, WHITE, torch.ones(shape))
            _refused(SvbrdfganError, f"grad_image of shape {shape} for a film of 4 x 6", call)

    def test_two_renderers_are_independent(self) -> None:
        """A second renderer, used in between, changes nothing of the first."""
        first, prepared = self.renderer, self.renderer.prepare(scenes.sphere())
        before = first.render(prepared, WHITE, VIEW, spp=2, seed=1).image
        second = self.make_renderer()
        second.render(second.prepare(scenes.plane()), scenes.lambertian(scenes.RED), VIEW, spp=2, seed=1)
        del second
        after = first.render(prepared, WHITE, VIEW, spp=2, seed=1).image
        check(torch.equal(before, after), "the same picture differs after another renderer was made and used.")

    def test_it_pickles(self) -> None:
        """A renderer that went through pickle renders the same."""
        again = pickle.loads(pickle.dumps(self.renderer))
        check(again.capabilities == self.capabilities, "its capabilities did not survive pickle.")
        images = [r.render(r.prepare(scenes.plane()), WHITE, VIEW, spp=2, seed=1).image for r in (self.renderer, again)]
        check(torch.equal(*images), "after pickle the same picture differs.")

    def test_its_repr_is_one_line(self) -> None:
        """Its repr is one line of at most 200 characters that names its class."""
        text = repr(self.renderer)
        short = "\n" not in text and len(text) <= 200
        check(short and type(self.renderer).__name__ in text, f"its repr is {text[:300]!r}.")


def _render(renderer: Renderer[Any], prepared: Any, materials: Materials, spp: int = 1) -> Callable[[], Rendering]:
    return partial(renderer.render, prepared, materials, VIEW, spp=spp, seed=0)


def _vjp(
    renderer: Renderer[Any],
    prepared: Any,
    wrt: frozenset[str],
    materials: Materials = WHITE,
    grad_image: Tensor = ONES,
) -> Callable[[], Gradients]:
    return partial(renderer.render_vjp, prepared, materials, VIEW, grad_image, wrt=wrt, spp=1, seed=0)


def _refused(wanted: type[SvbrdfganError], what: str, call: Callable[[], object]) -> None:
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
