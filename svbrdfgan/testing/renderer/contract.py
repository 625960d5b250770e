"""The protocol: methods and capabilities. The core refuses bad arguments before a renderer sees them."""

from __future__ import annotations

import inspect

import torch

from svbrdfgan.protocols import (
    DeferredRenderer,
    PullbackRenderer,
    Renderer,
    RendererCapabilities,
    TransportRenderer,
)
from svbrdfgan.rendering.checked_renderer import PreparedSurface, checked
from svbrdfgan.testing import scenes
from svbrdfgan.testing.contract import PluginTests
from svbrdfgan.testing.kit import check
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.types import CHANNELS, Gradients

WHITE = scenes.lambertian((1.0, 1.0, 1.0))
VIEW = scenes.front_view(scenes.random_light(), width=6, height=4)
ONES = torch.ones(4, 6, 3)


class ContractTests(PluginTests, RendererKit):
    """Protocol and capabilities."""

    def test_it_is_a_renderer(self) -> None:
        """It has every member of `Renderer`, and its device is a torch.device."""
        plugin = self.renderer.plugin
        check(isinstance(plugin, Renderer), f"{type(plugin).__name__} lacks a member of Renderer.")
        check(isinstance(self.renderer.device, torch.device), f"its device is {self.renderer.device!r}.")

    def test_methods_take_the_protocols_parameters(self) -> None:
        """Its methods take the protocol's parameters, by name and by kind."""
        methods: list[tuple[type, str]] = [(Renderer, "prepare"), (Renderer, "render"), (Renderer, "render_vjp")]
        methods += [(TransportRenderer, "transport")] if self.capabilities.transport else []
        methods += [(PullbackRenderer, "render_pullback")] if self.capabilities.pullback else []
        methods += [(DeferredRenderer, name) for name in ("store_light", "shade") if self.capabilities.deferred]
        for protocol, name in methods:
            there = callable(getattr(self.renderer.plugin, name, None))
            check(there, f"its capabilities declare {name}, and there is no such method.")
            wanted = list(inspect.signature(getattr(protocol, name)).parameters.values())[1:]
            found = list(inspect.signature(getattr(self.renderer.plugin, name)).parameters.values())
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

    def test_gradients_are_of_what_is_asked(self) -> None:
        """Gradients hold what `wrt` names, and nothing else."""
        prepared, known = self.renderer.prepare(scenes.plane()), self.capabilities.differentiable
        for wrt in (frozenset[str](), *(frozenset({name}) for name in sorted(known))):
            for name in ("render_vjp", *(("render_pullback",) if self.capabilities.pullback else ())):
                gradients = self._gradients(name, prepared, wrt)
                found, wanted = [set(part) for part in gradients.materials], [set(wrt & {"base_color"})]
                check(found == wanted, f"for wrt {sorted(wrt)}, {name}'s gradients hold {found}; wanted {wanted}.")
                light = "None" if gradients.environment is None else "given"
                right = (light == "given") == ("environment" in wrt)
                check(right, f"for wrt {sorted(wrt)}, {name}'s environment is {light}.")

    def test_two_renderers_are_independent(self) -> None:
        """A second renderer, used in between, changes nothing of the first."""
        first, prepared = self.renderer, self.renderer.prepare(scenes.sphere())
        before = first.render(prepared, WHITE, VIEW, spp=2, seed=1).image
        second = checked(self.make_renderer())
        second.render(second.prepare(scenes.plane()), scenes.lambertian(scenes.RED), VIEW, spp=2, seed=1)
        del second
        after = first.render(prepared, WHITE, VIEW, spp=2, seed=1).image
        check(torch.equal(before, after), "the same picture differs after another renderer was made and used.")

    def _gradients(self, method: str, prepared: PreparedSurface, wrt: frozenset[str]) -> Gradients:
        if method == "render_vjp":
            return self.renderer.render_vjp(prepared, WHITE, VIEW, ONES, wrt=wrt, spp=1, seed=0)
        return self.renderer.render_pullback(prepared, WHITE, VIEW, wrt=wrt, spp=1, seed=0)[1](ONES)
