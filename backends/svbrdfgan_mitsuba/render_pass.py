"""One picture, forward from samples to pixels, and backward from the pixels' gradient to maps and light."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Rendering, View
from svbrdfgan_mitsuba.integrator import DirectSamples, PathIntegrator
from svbrdfgan_mitsuba.interop import wait_for_torch
from svbrdfgan_mitsuba.prepared_scene import FilmChunk
from svbrdfgan_mitsuba.textures import GradientAccumulator

KEPT = {"cpu": 2**22, "cuda": 2**26}
"""Most camera samples kept for a gradient, 25 bytes each; the backward pass traces the others again."""


@dataclass(frozen=True, eq=False)
class RenderPass:
    """The inputs of one picture, and the samples kept for its gradient.

    Attributes:
        chunks: makes those of the film, which together cover it.
        wrt: inputs that the picture will be differentiated by.
        kept: samples that the backward pass need not trace again.
    """

    integrator: PathIntegrator
    view: View
    chunks: Callable[[], Iterator[FilmChunk]]
    device: torch.device
    wrt: frozenset[str] = frozenset()
    kept: dict[FilmChunk, DirectSamples] = field(default_factory=dict)

    def forward(self, *, keep: bool = False) -> Rendering:
        """The picture. Beyond it, its inputs and the kept samples, memory holds one chunk.

        Args:
            keep: whether to keep samples for the gradient. Only those of linear pictures can be used again, and only
                for the gradient of the base colour alone.
        """
        room = KEPT[self.device.type] if keep and self._direct else 0
        height, width = self.view.height, self.view.width
        image = torch.empty(height * width, 3, dtype=torch.float32, device=self.device)
        coverage = torch.empty(height * width, dtype=torch.float32, device=self.device)
        for chunk in self.chunks():
            room -= chunk.pixels * chunk.spp
            if room >= 0:
                self.kept[chunk] = self.integrator.trace_direct(chunk)
                made = self.integrator.forward_direct(chunk, self.kept[chunk])
            else:
                made = self.integrator.forward(chunk)
            image[chunk.span], coverage[chunk.span] = made
        return Rendering(image.view(height, width, 3), coverage.view(height, width))

    def backward(self, grad_image: Float[Tensor, "height width 3"]) -> Gradients:
        """The gradient of sum(image * grad_image), from the same samples."""
        maps, environment = self.integrator.tracer.maps, self.view.environment
        if not self.wrt:
            return Gradients(tuple({} for _ in maps.base_color.shapes))
        given = grad_image.detach().to(self.device, torch.float32).reshape(-1, 3)
        wait_for_torch(self.device)
        accumulator = GradientAccumulator.of(self.integrator.tracer.mi, maps, environment, self.wrt)
        for chunk in self.chunks():
            if self._direct:
                direct = self.kept.get(chunk) or self.integrator.trace_direct(chunk)
                self.integrator.backward_direct(chunk, direct, given[chunk.span], accumulator)
            else:
                self.integrator.backward(chunk, given[chunk.span], accumulator)
        return accumulator.gradients(maps, environment.radiance.shape)

    @property
    def _direct(self) -> bool:
        return self.integrator.linear and self.wrt == {"base_color"}
