"""The renderer: direct light, its gradients with respect to base colours and environment, and its transport."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError, UnsupportedError
from svbrdfgan.protocols import Pullback, RendererCapabilities
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_warp import scene
from svbrdfgan_warp.device import choose, in_order
from svbrdfgan_warp.light import Lights
from svbrdfgan_warp.records import Tracer, runs
from svbrdfgan_warp.scene import PreparedSurface
from svbrdfgan_warp.shot import Shot

CAPABILITIES = RendererCapabilities(
    maps=frozenset({"base_color"}),
    differentiable=frozenset({"base_color", "environment"}),
    transport=True,
    pullback=True,
)


@dataclass(frozen=True, init=False)
class WarpRenderer:
    """Direct light from the environment, by multiple importance sampling; on CUDA, or on all of torch's CPU threads.

    Pictures depend on the seed alone, not on the number of threads. Gradients do so too on the CPU; on CUDA they are
    summed by atomics, and may differ between runs in the last bits.
    """

    device: torch.device
    _lights: Lights = field(compare=False, repr=False)

    def __init__(self, device: str = "auto") -> None:
        """A renderer on `device`: "auto" (CUDA where there is one), "cpu", "cuda" or "cuda:N".

        Raises:
            ConfigError: another name, or a device that is not there.
        """
        object.__setattr__(self, "device", choose(device))
        object.__setattr__(self, "_lights", Lights(self.device))

    def __reduce__(self) -> tuple[type[WarpRenderer], tuple[str]]:
        return WarpRenderer, (str(self.device),)

    @property
    def capabilities(self) -> RendererCapabilities:
        return CAPABILITIES

    def prepare(self, surface: Surface) -> PreparedSurface:
        """The surface and a tree over its faces. The first call in a process loads or compiles kernels."""
        return scene.prepare(surface, self.device)

    def render(self, prepared: PreparedSurface, materials: Materials, view: View, *, spp: int, seed: int) -> Rendering:
        """The picture; unbiased. A film of any size needs no more memory than itself, the inputs and one chunk."""
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
        """The gradient of sum(image * grad_image): the transpose of `render` on the same samples.

        That of the environment takes the drawn directions as given.
        """
        shot = self._shot(prepared, materials, view, wrt, spp, seed)
        return _pullback(shot, wrt)(grad_image)

    def render_pullback(
        self, prepared: PreparedSurface, materials: Materials, view: View, *, wrt: frozenset[str], spp: int, seed: int
    ) -> tuple[Rendering, Pullback]:
        """The picture, and `render_vjp` of what was traced for it, which takes 24 bytes a sample, or 48 with light's.

        Of samples beyond `svbrdfgan_warp.shot.KEPT` nothing is kept; they are traced again.
        """
        shot = self._shot(prepared, materials, view, wrt, spp, seed)
        return shot.develop(keep=bool(wrt)), _pullback(shot, wrt)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` makes, before materials; sorted by pixel."""
        self._check(prepared, spp)
        tracer = Tracer.of(prepared, view, self._lights.of(view.environment))
        return in_order(lambda run: tracer(run).transport(), runs(view, spp, seed, self.device), self.device)

    def _shot(
        self, prepared: PreparedSurface, materials: Materials, view: View, wrt: frozenset[str], spp: int, seed: int
    ) -> Shot:
        self._check(prepared, spp)
        _check_materials(prepared, materials)
        if unknown := sorted(wrt - CAPABILITIES.differentiable):
            raise UnsupportedError(
                f"warp renderer: there is no gradient for {', '.join(unknown)}; "
                f"wrt may name {', '.join(sorted(CAPABILITIES.differentiable))}."
            )
        light = self._lights.of(view.environment)
        tracer = Tracer.of(prepared, view, light, arrivals="environment" in wrt)
        return Shot.of(tracer, view, runs(view, spp, seed, self.device), materials)

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


def _pullback(shot: Shot, wrt: frozenset[str]) -> Pullback:
    def pullback(grad_image: Float[Tensor, "height width 3"]) -> Gradients:
        film = (shot.view.height, shot.view.width, 3)
        if grad_image.shape != film:
            raise ConfigError(f"warp renderer: grad_image has shape {tuple(grad_image.shape)}; wanted {film}.")
        return shot.backpropagate(grad_image, wrt)

    return pullback
