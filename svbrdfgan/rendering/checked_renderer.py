"""The door through which the core calls renderers: all checks of arguments, so that plugins need none."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Pullback, Renderer, RendererCapabilities, StoredLight
from svbrdfgan.rendering import validation
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, TransportSamples, View


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """A surface as a renderer prepared it.

    Attributes:
        value: what the plugin's own `prepare` returned.
        parts: names of the surface's parts, in order.
        renderer, device: which renderer prepared it, and where.
    """

    value: Any
    parts: tuple[str, ...]
    renderer: str
    device: torch.device


@dataclass(frozen=True, eq=False)
class CheckedLight:
    """The stored light of a view, with what `shade` needs to know to check its arguments.

    Attributes:
        value: what the plugin's own `store_light` returned.
        film: height and width of the view's picture, pixels.
        learnable: number of learnable parts.
        surface: the prepared surface.
    """

    value: StoredLight
    film: tuple[int, int]
    learnable: int
    surface: PreparedSurface

    @property
    def nbytes(self) -> int:
        """Bytes of memory that keeping the light takes."""
        return self.value.nbytes


@dataclass(frozen=True)
class CheckedRenderer:
    """A renderer with every method of `svbrdfgan.protocols`, whose arguments are checked at every call.

    An optional method raises `UnsupportedError` unless `capabilities` declares it. `svbrdfgan.load_renderer` returns a
    checked renderer. `CheckedRenderer(MyRenderer(), "mine")` makes one of a renderer that is not installed.

    Attributes:
        plugin: the renderer itself, which may rely on its arguments.
        name: how messages call it.
    """

    plugin: Renderer[Any]
    name: str

    @property
    def capabilities(self) -> RendererCapabilities:
        return self.plugin.capabilities

    @property
    def device(self) -> torch.device:
        return self.plugin.device

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The data that depends only on geometry; see `Renderer.prepare`."""
        parts = tuple(part.name for part in surface.parts)
        return PreparedSurface(self.plugin.prepare(surface), parts, self.name, self.device)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; see `Renderer.render`."""
        self._check(prepared, materials, view, spp)
        return self.plugin.render(prepared.value, materials, view, spp=spp, seed=seed)

    def render_vjp(
        self,
        prepared: PreparedSurface,
        materials: Materials,
        view: View,
        grad_image: Float[Tensor, "height width 3"],
        *,
        wrt: frozenset[str],
        spp: int,
        seed: int,
    ) -> Gradients:
        """The gradient of sum(image * grad_image); see `Renderer.render_vjp`."""
        self._check(prepared, materials, view, spp, wrt)
        validation.check_cotangent(self.name, (view.height, view.width, 3), grad_image)
        return self.plugin.render_vjp(prepared.value, materials, view, grad_image, wrt=wrt, spp=spp, seed=seed)

    def render_pullback(
        self, prepared: PreparedSurface, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """The picture, and its gradient as a function; see `PullbackRenderer.render_pullback`."""
        plugin: Any = self._declaring("pullback")
        self._check(prepared, materials, view, spp, wrt)
        rendering, pullback = plugin.render_pullback(prepared.value, materials, view, wrt=wrt, spp=spp, seed=seed)

        def checked_pullback(grad_image: Float[Tensor, "height width 3"]) -> Gradients:
            validation.check_cotangent(self.name, (view.height, view.width, 3), grad_image)
            gradients: Gradients = pullback(grad_image)
            return gradients

        return rendering, checked_pullback

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples of the picture without materials; see `TransportRenderer.transport`."""
        plugin: Any = self._declaring("transport")
        self._check_scene(prepared, view, spp)
        samples: Iterator[TransportSamples] = plugin.transport(prepared.value, view, spp=spp, seed=seed)
        return samples

    def store_light(
        self, prepared: PreparedSurface, view: View, *, learnable: Sequence[int], hits: int, spp: int, seed: int
    ) -> CheckedLight:
        """The stored light of a view; see `DeferredRenderer.store_light`."""
        plugin: Any = self._declaring("deferred")
        self._check_scene(prepared, view, spp)
        validation.check_stored(self.name, prepared.parts, learnable, hits)
        light = plugin.store_light(prepared.value, view, learnable=learnable, hits=hits, spp=spp, seed=seed)
        return CheckedLight(light, (view.height, view.width), len(learnable), prepared)

    def shade(
        self,
        lights: Sequence[CheckedLight],
        textures: Float[Tensor, "textures rows cols channels"],
        *,
        maps: Sequence[str],
        visit: int,
        seed: int,
    ) -> tuple[Float[Tensor, "views height width 3"], Callable[[Tensor], Tensor]]:
        """Pictures of the learnable parts from stored light; see `DeferredRenderer.shade`."""
        plugin: Any = self._declaring("deferred")
        for light in lights:
            self._check_prepared(light.surface)
        views = [(light.film, light.learnable) for light in lights]
        validation.check_shade(self.name, self.capabilities, views, textures, maps, visit=visit)
        images, pullback = plugin.shade([light.value for light in lights], textures, maps=maps, visit=visit, seed=seed)

        def checked_pullback(grad_images: Tensor) -> Tensor:
            validation.check_cotangent(self.name, images.shape, grad_images)
            gradient: Tensor = pullback(grad_images)
            return gradient

        return images, checked_pullback

    def require_differentiable(self, wrt: frozenset[str]) -> None:
        """Checks that the renderer has gradients for all of these inputs.

        Raises:
            UnsupportedError: a name is not in `capabilities.differentiable`.
        """
        validation.check_differentiable(self.name, self.capabilities, wrt)

    def _declaring(self, power: str) -> Renderer[Any]:
        """The plugin, if its capabilities declare this power."""
        validation.check_declared(self.name, self.capabilities, power)
        return self.plugin

    def _check(
        self,
        prepared: PreparedSurface,
        materials: Materials,
        view: View,
        spp: int,
        wrt: frozenset[str] = frozenset(),
    ) -> None:
        self._check_scene(prepared, view, spp)
        validation.check_materials(self.name, self.capabilities, prepared.parts, materials)
        self.require_differentiable(wrt)

    def _check_scene(self, prepared: PreparedSurface, view: View, spp: int) -> None:
        self._check_prepared(prepared)
        validation.check_samples(self.name, spp)
        validation.check_radiance(view.environment.radiance)

    def _check_prepared(self, prepared: PreparedSurface) -> None:
        if not isinstance(prepared, PreparedSurface):
            raise ConfigError(
                f"{self.name} renderer: the surface is a {type(prepared).__name__}; wanted what this renderer's own "
                "prepare returns."
            )
        if (prepared.renderer, prepared.device) != (self.name, self.device):
            raise ConfigError(
                f"{self.name} renderer: the surface was prepared by {prepared.renderer} on {prepared.device}; prepare "
                f"it again by {self.name} on {self.device}."
            )


def checked(renderer: Renderer[Any]) -> CheckedRenderer:
    """The renderer behind the core's checks, named after its class unless it is there already."""
    return renderer if isinstance(renderer, CheckedRenderer) else CheckedRenderer(renderer, type(renderer).__name__)
