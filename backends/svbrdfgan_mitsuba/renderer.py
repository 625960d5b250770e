"""The renderer: pictures, gradients and transport, by Mitsuba's ray tracing and Dr.Jit's kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Pullback, RendererCapabilities
from svbrdfgan.types import Gradients, Material, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_mitsuba import variant
from svbrdfgan_mitsuba.environment import EnvironmentEmitter
from svbrdfgan_mitsuba.integrator import PathIntegrator
from svbrdfgan_mitsuba.interop import wait_for_torch
from svbrdfgan_mitsuba.prepared_scene import FilmChunk, PreparedCamera, PreparedSurface, film_chunks, prepare
from svbrdfgan_mitsuba.render_pass import RenderPass
from svbrdfgan_mitsuba.textures import NEUTRAL, MaterialMaps, snapshot
from svbrdfgan_mitsuba.vertex import PathTracer


@dataclass(frozen=True, init=False)
class MitsubaRenderer:
    """A path tracer on Mitsuba 3 that neither reads nor sets `mitsuba.variant()`.

    Pictures depend only on the seed. Atomics sum the gradients in varying order, so their last bits may differ.
    """

    device: torch.device
    max_bounces: int

    def __init__(self, device: str = "auto", max_bounces: int = 1) -> None:
        """A renderer on `device`: "auto" (CUDA where it works), "cpu", "cuda" or "cuda:0".

        Args:
            max_bounces: scattering events on a path, 1 to 64. Only 1, direct light, has `transport`.

        Raises:
            ConfigError: an unknown device, one that does not exist, or bounces out of range.
            PluginError: no usable LLVM for the CPU, or a GPU that Dr.Jit cannot use.
        """
        if not 1 <= max_bounces <= 64:
            raise ConfigError(f"mitsuba renderer: max_bounces is {max_bounces}; wanted 1 to 64.")
        object.__setattr__(self, "max_bounces", max_bounces)
        object.__setattr__(self, "device", variant.choose_device(device))

    @property
    def capabilities(self) -> RendererCapabilities:
        return RendererCapabilities(
            maps=frozenset(NEUTRAL),
            differentiable=frozenset({*NEUTRAL, "environment"}),
            max_bounces=self.max_bounces,
            transport=self.max_bounces == 1,
            stochastic=True,
            pullback=True,
            alpha=True,
        )

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface and its search tree on the renderer's device."""
        return prepare(surface, self.device)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; see `Renderer.render`. Beyond it and its inputs, memory holds one chunk of the film."""
        return self._render_pass(prepared, materials, view, frozenset(), spp, seed).forward()

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
        """The gradient; see `Renderer.render_vjp`. All but base colour's treat the drawn directions as constants."""
        return self._render_pass(prepared, materials, view, wrt, spp, seed).backward(grad_image)

    def render_pullback(
        self, prepared: PreparedSurface, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """The picture, and `render_vjp`; see `PullbackRenderer`.

        With direct light, no roughness and `wrt` of the base colour alone, paths are traced only once, up to
        `svbrdfgan_mitsuba.render_pass.KEPT` samples. Otherwise the pullback traces them again.
        """
        render_pass = self._render_pass(prepared, snapshot(materials), view, wrt, spp, seed)
        return render_pass.forward(keep=True), render_pass.backward

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` draws, without materials, sorted by pixel."""
        white = Materials(tuple(Material.lambertian((1.0, 1.0, 1.0)) for _ in prepared.parts))
        integrator = self._integrator(prepared, white, view)
        return (integrator.transport(chunk) for chunk in self._chunks(view, spp, seed)())

    def _render_pass(
        self, prepared: PreparedSurface, materials: Materials, view: View, wrt: frozenset[str], spp: int, seed: int
    ) -> RenderPass:
        integrator, chunks = self._integrator(prepared, materials, view), self._chunks(view, spp, seed)
        return RenderPass(integrator, view, chunks, self.device, wrt)

    def _chunks(self, view: View, spp: int, seed: int) -> Callable[[], Iterator[FilmChunk]]:
        return partial(film_chunks, view.height * view.width, spp, seed, self.max_bounces, self.device)

    def _integrator(self, prepared: PreparedSurface, materials: Materials, view: View) -> PathIntegrator:
        maps = MaterialMaps.of(prepared.mi, materials, prepared.repeat, self.device)
        emitter = EnvironmentEmitter.of(prepared.mi, view.environment, self.device)
        tracer = PathTracer(prepared, PreparedCamera.of(prepared, view), emitter, maps)
        wait_for_torch(self.device)
        return PathIntegrator(tracer, self.max_bounces)
