"""The renderer: direct light, its gradients with respect to base colours and environment, and its transport."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_warp import kernels, scene, textures
from svbrdfgan_warp.adjoint import Adjoint
from svbrdfgan_warp.device import choose, in_order, launch
from svbrdfgan_warp.records import Run, Tracer, runs
from svbrdfgan_warp.scene import PreparedSurface

CAPABILITIES = RendererCapabilities(
    maps=frozenset({"base_color"}), differentiable=frozenset({"base_color", "environment"}), transport=True
)


@dataclass(frozen=True, init=False)
class WarpRenderer:
    """Direct light from the environment, by multiple importance sampling; on CUDA, or on all of torch's CPU threads.

    Pictures depend on the seed alone, not on the number of threads. Gradients do so too on the CPU; on CUDA they are
    summed by atomics, and may differ between runs in the last bits.
    """

    device: torch.device

    def __init__(self, device: str = "auto") -> None:
        """A renderer on `device`: "auto" (CUDA where there is one), "cpu", "cuda" or "cuda:N".

        Raises:
            ConfigError: another name, or a device that is not there.
        """
        object.__setattr__(self, "device", choose(device))

    @property
    def capabilities(self) -> RendererCapabilities:
        return CAPABILITIES

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface and its BVH on the renderer's device. The first call in a process loads or compiles kernels."""
        return scene.prepare(surface, self.device)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; unbiased. A film of any size needs no more memory than itself, the inputs and one chunk."""
        self._check(prepared, spp)
        _check_materials(prepared, materials)
        film = view.height * view.width
        image = torch.empty(film, 3, dtype=torch.float32, device=self.device)
        coverage = torch.empty(film, dtype=torch.float32, device=self.device)
        atlas = textures.atlas(textures.shapes(materials), prepared.repeat, self.device)
        texels = wp.from_torch(textures.pack(materials, self.device), wp.vec3)
        results = wp.from_torch(image, wp.vec3), wp.from_torch(coverage)
        tracer = Tracer.of(prepared, view)

        def develop(run: Run) -> None:
            launch(kernels.gather, run.pixels, (atlas, *tracer(run).arguments(), texels, *results), self.device)

        for _ in in_order(develop, runs(view, spp, seed, self.device), self.device):
            pass
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
        """The gradient of sum(image * grad_image): the transpose of `render` on the same samples.

        That of the environment takes the drawn directions as given.
        """
        self._check(prepared, spp)
        _check_materials(prepared, materials)
        _check_gradient(wrt, view, grad_image)
        if not wrt:
            return Gradients(tuple({} for _ in materials.parts))
        tracer = Tracer.of(prepared, view, arrivals="environment" in wrt)
        adjoint = Adjoint.of(prepared, materials, view, grad_image, wrt)
        for records in in_order(tracer, runs(view, spp, seed, self.device), self.device):
            adjoint.add(records)
        return adjoint.gradients(materials)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` makes, before materials; sorted by pixel."""
        self._check(prepared, spp)
        tracer = Tracer.of(prepared, view)
        return in_order(lambda run: tracer(run).transport(), runs(view, spp, seed, self.device), self.device)

    def _check(self, prepared: PreparedSurface, spp: int) -> None:
        if spp < 1:
            raise ConfigError(f"warp renderer: spp is {spp}; wanted at least 1 sample per pixel.")
        if prepared.device != self.device:
            raise ConfigError(
                f"warp renderer: the surface was prepared on {prepared.device}; prepare it again for {self.device}."
            )


def _check_materials(prepared: PreparedSurface, materials: Materials) -> None:
    if len(materials) != len(prepared.parts):
        raise ConfigError(
            f"warp renderer: got {len(materials)} materials for a surface of {len(prepared.parts)} parts; "
            "wanted one for each part, in the surface's order."
        )
    for part, material in zip(prepared.parts, materials.parts, strict=True):
        if unread := sorted(material.maps.keys() - CAPABILITIES.maps):
            raise UnsupportedError(
                f"warp renderer: the material of part {part!r} has {', '.join(unread)}, but this renderer reads "
                "base_color alone: drop the map, or take a renderer that reads it (`svbrdfgan backends` shows maps)."
            )


def _check_gradient(wrt: frozenset[str], view: View, grad_image: Tensor) -> None:
    if unknown := sorted(wrt - CAPABILITIES.differentiable):
        raise UnsupportedError(
            f"warp renderer: there is no gradient for {', '.join(unknown)}; "
            f"wrt may name {', '.join(sorted(CAPABILITIES.differentiable))}."
        )
    film = (view.height, view.width, 3)
    if grad_image.shape != film:
        raise ConfigError(f"warp renderer: grad_image has shape {tuple(grad_image.shape)}; wanted {film}.")
