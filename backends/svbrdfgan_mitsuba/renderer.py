"""The renderer: pictures, gradients and transport, on Mitsuba's search tree and Dr.Jit's kernels."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Pullback, RendererCapabilities
from svbrdfgan.rendering.validation import check_cotangent, check_device, check_radiance, check_render, check_transport
from svbrdfgan.types import Gradients, Material, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_mitsuba import scene, variant
from svbrdfgan_mitsuba.film import Run, runs
from svbrdfgan_mitsuba.interop import wait_for_torch
from svbrdfgan_mitsuba.light import Light
from svbrdfgan_mitsuba.paths import Paths
from svbrdfgan_mitsuba.render_pass import Shot
from svbrdfgan_mitsuba.scene import Lens, PreparedSurface
from svbrdfgan_mitsuba.textures import Maps, own
from svbrdfgan_mitsuba.vertex import Tracer


@dataclass(frozen=True, init=False)
class MitsubaRenderer:
    """A path tracer on Mitsuba 3; `mitsuba.variant()` is neither read nor set.

    Pictures depend on the seed alone. Gradients are summed by atomics, and may differ between runs in the last bits.
    """

    device: torch.device
    max_bounces: int

    def __init__(self, device: str = "auto", max_bounces: int = 1) -> None:
        """A renderer on `device`: "auto" (CUDA where it works), "cpu", "cuda" or "cuda:0".

        Args:
            max_bounces: scattering events on a path, 1 to 64. 1 is direct light, and only then is there `transport`.

        Raises:
            ConfigError: another device, one that is not there, or bounces out of range.
            PluginError: there is no LLVM for the CPU that can be relied on, or Dr.Jit cannot use the GPU asked for.
        """
        if not 1 <= max_bounces <= 64:
            raise ConfigError(f"mitsuba renderer: max_bounces is {max_bounces}; wanted 1 to 64.")
        object.__setattr__(self, "max_bounces", max_bounces)
        object.__setattr__(self, "device", variant.choose(device))

    @property
    def capabilities(self) -> RendererCapabilities:
        return RendererCapabilities(
            maps=frozenset({"base_color", "roughness"}),
            differentiable=frozenset({"base_color", "roughness", "environment"}),
            max_bounces=self.max_bounces,
            transport=self.max_bounces == 1,
            stochastic=True,
            pullback=True,
        )

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface and its search tree on the renderer's device."""
        return scene.prepare(surface, self.device)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; see `Renderer.render`. It needs no more memory than itself, its inputs and one run."""
        return self._shot(prepared, materials, view, frozenset(), spp, seed).develop()

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
        """The gradient; see `Renderer.render_vjp`. Those of roughness and light take the drawn directions as given."""
        check_cotangent("mitsuba", view, grad_image)
        return self._shot(prepared, materials, view, wrt, spp, seed).backpropagate(grad_image)

    def render_pullback(
        self, prepared: PreparedSurface, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """The picture, and `render_vjp`; see `PullbackRenderer`.

        Nothing is traced twice where light is direct, no material is rough, and `wrt` is the base colour alone; but for
        samples beyond `svbrdfgan_mitsuba.render_pass.KEPT`.
        """
        shot = self._shot(prepared, own(materials), view, wrt, spp, seed)

        def pullback(grad_image: Float[Tensor, "height width 3"]) -> Gradients:
            check_cotangent("mitsuba", view, grad_image)
            return shot.backpropagate(grad_image)

        return shot.develop(keep=True), pullback

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` makes, before materials; sorted by pixel.

        Raises:
            UnsupportedError: paths have more than one bounce, so that pictures are not linear in the base colour.
        """
        check_transport("mitsuba", self.capabilities, spp=spp)
        white = Materials(tuple(Material.lambertian((1.0, 1.0, 1.0)) for _ in prepared.parts))
        paths = self._paths(prepared, white, view)
        return (paths.record(run) for run in self._runs(view, spp, seed))

    def _shot(
        self, prepared: PreparedSurface, materials: Materials, view: View, wrt: frozenset[str], spp: int, seed: int
    ) -> Shot:
        check_render("mitsuba", self.capabilities, prepared.parts, materials, spp=spp, wrt=wrt)
        return Shot(self._paths(prepared, materials, view), view, self._runs(view, spp, seed), self.device, wrt)

    def _runs(self, view: View, spp: int, seed: int) -> list[Run]:
        return runs(view.height * view.width, spp, seed, self.max_bounces, self.device)

    def _paths(self, prepared: PreparedSurface, materials: Materials, view: View) -> Paths:
        check_device("mitsuba", prepared.device, self.device)
        check_radiance(view.environment.radiance)
        maps = Maps.of(prepared.mi, materials, prepared.repeat, self.device)
        light = Light.of(prepared.mi, view.environment, self.device)
        paths = Paths(Tracer(prepared, Lens.of(prepared, view), light, maps), self.max_bounces)
        wait_for_torch(self.device)
        return paths
