"""The renderer: pictures, gradients and transport, on Mitsuba's search tree and Dr.Jit's kernels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Gradients, Material, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_mitsuba import scene, variant
from svbrdfgan_mitsuba.checks import check_call, check_environment, check_gradient, check_materials
from svbrdfgan_mitsuba.exchange import wait_for_torch
from svbrdfgan_mitsuba.film import Run, runs
from svbrdfgan_mitsuba.light import Light
from svbrdfgan_mitsuba.paths import Paths
from svbrdfgan_mitsuba.scene import Lens, PreparedSurface
from svbrdfgan_mitsuba.sums import Sums
from svbrdfgan_mitsuba.textures import Maps
from svbrdfgan_mitsuba.vertex import Tracer


@dataclass(frozen=True, init=False)
class MitsubaRenderer:
    """A path tracer on Mitsuba 3; `mitsuba.variant()` is neither read nor set.

    Pictures depend on the seed alone. Gradients are summed by atomics, and may differ between runs in the last bits.
    """

    device: torch.device
    max_bounces: int

    def __init__(self, device: str = "auto", max_bounces: int = 1) -> None:
        """A renderer on `device`: "auto" (CUDA where there is one), "cpu", "cuda" or "cuda:0".

        Args:
            max_bounces: scattering events on a path, 1 to 64. 1 is direct light, and only then is there `transport`.

        Raises:
            ConfigError: another device, one that is not there, or bounces out of range.
            PluginError: there is no LLVM for the CPU that can be relied on.
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
        )

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface and its search tree on the renderer's device."""
        return scene.prepare(surface, self.device)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; see `Renderer.render`. It needs no more memory than itself, its inputs and one run."""
        check_call(prepared, self.device, spp)
        check_materials(prepared.parts, materials, self.capabilities)
        maps = self._maps(prepared, materials)
        paths = self._paths(prepared, maps, view)
        pieces = [paths.develop(run) for run in self._runs(view, spp, seed)]
        image, coverage = (_joined(part) for part in zip(*pieces, strict=True))
        return Rendering(image.view(view.height, view.width, 3), coverage.view(view.height, view.width))

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
        check_call(prepared, self.device, spp)
        check_materials(prepared.parts, materials, self.capabilities)
        check_gradient(view, grad_image, wrt, self.capabilities)
        if not wrt:
            return Gradients(tuple({} for _ in materials.parts))
        given = grad_image.detach().to(self.device, torch.float32).reshape(-1, 3)
        maps = self._maps(prepared, materials)
        paths = self._paths(prepared, maps, view)
        sums = Sums.of(prepared.mi, maps, view.environment, wrt)
        for run in self._runs(view, spp, seed):
            paths.backpropagate(run, given[run.film], sums)
        return sums.gradients(maps, view.environment.radiance.shape)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` makes, before materials; sorted by pixel.

        Raises:
            UnsupportedError: paths have more than one bounce, so that pictures are not linear in the base colour.
        """
        if self.max_bounces > 1:
            raise UnsupportedError(
                f"mitsuba renderer: transport is for direct light, and max_bounces is {self.max_bounces}; set it to 1."
            )
        check_call(prepared, self.device, spp)
        white = Materials(tuple(Material.lambertian((1.0, 1.0, 1.0)) for _ in prepared.parts))
        paths = self._paths(prepared, self._maps(prepared, white), view)
        return (paths.record(run) for run in self._runs(view, spp, seed))

    def _runs(self, view: View, spp: int, seed: int) -> list[Run]:
        return runs(view.height * view.width, spp, seed, self.max_bounces, self.device)

    def _maps(self, prepared: PreparedSurface, materials: Materials) -> Maps:
        return Maps.of(prepared.mi, materials, prepared.repeat, self.device)

    def _paths(self, prepared: PreparedSurface, maps: Maps, view: View) -> Paths:
        check_environment(view.environment)
        light = Light.of(prepared.mi, view.environment, self.device)
        paths = Paths(Tracer(prepared, Lens.of(prepared, view), light, maps), self.max_bounces)
        wait_for_torch(self.device)
        return paths


def _joined(pieces: Sequence[Tensor]) -> Tensor:
    return pieces[0] if len(pieces) == 1 else torch.cat(tuple(pieces))
