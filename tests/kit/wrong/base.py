"""A right renderer, to be made wrong in one of its steps; and what its heirs change results with."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, ClassVar
from unittest import mock

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import PluginError
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.protocols import Pullback, RendererCapabilities
from svbrdfgan.rendering.checked_renderer import CheckedLight, CheckedRenderer
from svbrdfgan.types import Environment, Gradients, Material, Materials, Rendering, Surface, TransportSamples, View

COLOR_ALONE: Mapping[str, Any] = MappingProxyType(
    {
        "maps": frozenset({"base_color"}),
        "differentiable": frozenset({"base_color", "environment"}),
        "deferred": False,
    }
)
"""Claims of a renderer that reads no other map."""


@functools.cache
def fast_renderer() -> CheckedRenderer:
    """The fastest that there is on any machine."""
    try:
        return load_renderer("warp", {"device": "cpu"})
    except PluginError:
        return load_renderer("numpy")


@functools.cache
def slow_renderer(max_bounces: int) -> CheckedRenderer:
    """The one that can be read, and bent."""
    return load_renderer("numpy", {"max_bounces": max_bounces})


@dataclass(frozen=True, eq=False)
class Call:
    """What is asked of a renderer: a picture, its gradient, or its transport."""

    surface: Surface
    prepared: Any
    materials: Materials
    view: View
    spp: int
    seed: int
    wrt: frozenset[str] = frozenset()
    grad_image: Tensor | None = None

    def seen_with(self, environment: Environment) -> Call:
        return replace(self, view=replace(self.view, environment=environment))


@dataclass(frozen=True)
class Right:
    """A right renderer. Its heirs are wrong in one of the steps below, which here do nothing."""

    claims: ClassVar[Mapping[str, Any]] = MappingProxyType({})

    def surface(self, surface: Surface) -> Surface:
        """What is prepared."""
        return surface

    def asked(self, call: Call) -> Call:
        """What is rendered, differentiated or sampled."""
        return call

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return rendering

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradients

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        return samples

    @property
    def right(self) -> CheckedRenderer:
        return fast_renderer()

    @property
    def capabilities(self) -> RendererCapabilities:
        return replace(self.right.capabilities, **self.claims)

    @property
    def device(self) -> torch.device:
        return self.right.device

    def prepare(self, surface: Surface) -> tuple[Surface, Any]:
        changed = self.surface(surface)
        return changed, self.right.prepare(changed)

    def render(self, prepared: Any, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        call = Call(*prepared, materials, view, spp, seed)
        c = self.asked(call)
        return self.picture(self.right.render(c.prepared, c.materials, c.view, spp=c.spp, seed=c.seed), call)

    def render_vjp(
        self,
        prepared: Any,
        materials: Materials,
        view: View,
        grad_image: Float[Tensor, "height width 3"],
        *,
        wrt: frozenset[str],
        spp: int,
        seed: int,
    ) -> Gradients:
        call = Call(*prepared, materials, view, spp, seed, wrt, grad_image)
        asked = replace(self.asked(call), grad_image=self.cotangent(grad_image, call))
        return self.gradient(self.vjp(asked), call)

    def render_pullback(
        self, prepared: Any, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        owned = self.kept(materials, view)

        def pullback(grad_image: Float[Tensor, "height width 3"]) -> Gradients:
            return self.render_vjp(prepared, *owned, grad_image, wrt=wrt, spp=spp, seed=seed)

        return self.render(prepared, materials, view, spp=spp, seed=seed), pullback

    def kept(self, materials: Materials, view: View) -> tuple[Materials, View]:
        """What a pullback remembers: as it was."""
        maps = [{name: value.detach().clone() for name, value in m.maps.items()} for m in materials.parts]
        light = replace(view.environment, radiance=view.environment.radiance.detach().clone())
        return Materials(tuple(map(Material, maps))), replace(view, environment=light)

    def vjp(self, call: Call, renderer: CheckedRenderer | None = None) -> Gradients:
        """The right gradient."""
        c, right = call, renderer or self.right
        assert c.grad_image is not None
        return right.render_vjp(c.prepared, c.materials, c.view, c.grad_image, wrt=c.wrt, spp=c.spp, seed=c.seed)

    def transport(self, prepared: Any, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        call = Call(*prepared, Materials(()), view, spp, seed)
        c = self.asked(call)
        found = self.right.transport(c.prepared, c.view, spp=c.spp, seed=c.seed)
        return (self.samples(samples, call) for samples in found)

    def store_light(
        self, prepared: Any, view: View, *, learnable: Sequence[int], hits: int, spp: int, seed: int
    ) -> CheckedLight:
        return self.right.store_light(prepared[1], view, learnable=learnable, hits=hits, spp=spp, seed=seed)

    def shade(
        self,
        lights: Sequence[CheckedLight],
        textures: Float[Tensor, "textures rows cols channels"],
        *,
        maps: Sequence[str],
        visit: int,
        seed: int,
    ) -> tuple[Float[Tensor, "views height width 3"], Callable[[Tensor], Tensor]]:
        return self.right.shade(lights, textures, maps=maps, visit=visit, seed=seed)


def each_map(gradients: Gradients, change: Callable[[Tensor], Tensor]) -> Gradients:
    """The gradients with every map's changed."""
    parts = tuple({name: change(value) for name, value in part.items()} for part in gradients.materials)
    return replace(gradients, materials=parts)


def light_of(gradients: Gradients, change: Callable[[Tensor], Tensor]) -> Gradients:
    """The gradients with the environment's changed."""
    light = gradients.environment
    return replace(gradients, environment=None if light is None else change(light))


def with_colors(materials: Materials, change: Callable[[Tensor], Tensor]) -> Materials:
    """The materials with every base colour changed."""
    return Materials(tuple(Material({**m.maps, "base_color": change(m.base_color)}) for m in materials.parts))


def scaled(rendering: Rendering, factor: float) -> Rendering:
    return replace(rendering, image=rendering.image * factor)


class OnNumpy(Right):
    """The slow renderer instead of the fast one."""

    bounces: ClassVar[int] = 1

    @property
    def right(self) -> CheckedRenderer:
        return slow_renderer(self.bounces)


Patch = tuple[object, str, Any]
"""A module or a class, the name of a function or property in it, and what it is replaced with."""


class Patched(OnNumpy):
    """The slow renderer with some of its functions replaced while it works."""

    def patches(self) -> list[Patch]:
        raise NotImplementedError

    def render(self, prepared: Any, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        with patched(*self.patches()):
            return super().render(prepared, materials, view, spp=spp, seed=seed)

    def render_vjp(
        self,
        prepared: Any,
        materials: Materials,
        view: View,
        grad_image: Float[Tensor, "height width 3"],
        *,
        wrt: frozenset[str],
        spp: int,
        seed: int,
    ) -> Gradients:
        with patched(*self.patches()):
            return super().render_vjp(prepared, materials, view, grad_image, wrt=wrt, spp=spp, seed=seed)

    def transport(self, prepared: Any, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        with patched(*self.patches()):
            samples = list(super().transport(prepared, view, spp=spp, seed=seed))
        return iter(samples)


def patched(*patches: Patch) -> ExitStack:
    """Replaces functions until it is closed."""
    stack = ExitStack()
    for owner, name, replacement in patches:
        stack.enter_context(mock.patch.object(owner, name, replacement))
    return stack


def with_map(materials: Materials, name: str, change: Callable[[Tensor], Tensor]) -> Materials:
    """The materials with every map of this name changed."""
    return Materials(
        tuple(
            Material({n: change(value.detach()) if n == name else value for n, value in material.maps.items()})
            for material in materials.parts
        )
    )


def gradient_of(gradients: Gradients, name: str, change: Callable[[Tensor], Tensor]) -> Gradients:
    """The gradients with those of every map of this name changed."""
    parts = [{n: change(value) if n == name else value for n, value in part.items()} for part in gradients.materials]
    return replace(gradients, materials=tuple(parts))
