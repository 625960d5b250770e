"""The renderer: direct light, its gradients with respect to base colours and environment, and its transport."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.protocols import Pullback, RendererCapabilities
from svbrdfgan.rendering.validation import check_cotangent, check_device, check_render, check_transport
from svbrdfgan.types import Gradients, Materials, Rendering, Surface, TransportSamples, View
from svbrdfgan_warp import scene
from svbrdfgan_warp.device import choose, in_order
from svbrdfgan_warp.light import Lights
from svbrdfgan_warp.records import Tracer, runs
from svbrdfgan_warp.render_pass import Shot
from svbrdfgan_warp.scene import PreparedSurface

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

        Of samples beyond `svbrdfgan_warp.render_pass.KEPT` nothing is kept; they are traced again.
        """
        shot = self._shot(prepared, materials, view, wrt, spp, seed)
        return shot.develop(keep=bool(wrt)), _pullback(shot, wrt)

    def transport(self, prepared: PreparedSurface, view: View, *, spp: int, seed: int) -> Iterator[TransportSamples]:
        """The samples that `render` makes, before materials; sorted by pixel."""
        check_transport("warp", CAPABILITIES, spp=spp)
        tracer = self._tracer(prepared, view)
        return in_order(lambda run: tracer(run).transport(), runs(view, spp, seed, self.device), self.device)

    def _shot(
        self, prepared: PreparedSurface, materials: Materials, view: View, wrt: frozenset[str], spp: int, seed: int
    ) -> Shot:
        check_render("warp", CAPABILITIES, prepared.parts, materials, spp=spp, wrt=wrt)
        tracer = self._tracer(prepared, view, arrivals="environment" in wrt)
        return Shot.of(tracer, view, runs(view, spp, seed, self.device), materials)

    def _tracer(self, prepared: PreparedSurface, view: View, *, arrivals: bool = False) -> Tracer:
        check_device("warp", prepared.device, self.device)
        return Tracer.of(prepared, view, self._lights.of(view.environment), arrivals=arrivals)


def _pullback(shot: Shot, wrt: frozenset[str]) -> Pullback:
    def pullback(grad_image: Float[Tensor, "height width 3"]) -> Gradients:
        check_cotangent("warp", shot.view, grad_image)
        return shot.backpropagate(grad_image, wrt)

    return pullback
