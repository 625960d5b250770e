"""One picture, from its samples to its pixels, and from the pixels' gradient back to what they depend on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Rendering, View
from svbrdfgan_mitsuba.film import Run
from svbrdfgan_mitsuba.gradient_accumulation import Sums
from svbrdfgan_mitsuba.interop import wait_for_torch
from svbrdfgan_mitsuba.paths import Direct, Paths

KEPT = {"cpu": 2**22, "cuda": 2**26}
"""Camera samples kept for a gradient, at most, 25 bytes each; what is beyond is traced again."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What a picture is made of.

    Attributes:
        wrt: what it is to be differentiated by.
        kept: samples that need not be traced again.
    """

    paths: Paths
    view: View
    runs: list[Run]
    device: torch.device
    wrt: frozenset[str] = frozenset()
    kept: dict[Run, Direct] = field(default_factory=dict)

    def develop(self, *, keep: bool = False) -> Rendering:
        """The picture. It needs no more memory than itself, its inputs and one run, and what is kept of it.

        Args:
            keep: what the gradient may be found by without tracing: of pictures linear in the base colour, where that
                alone is wanted. Others keep nothing.
        """
        room = KEPT[self.device.type] if keep and self._direct else 0
        pieces = []
        for run in self.runs:
            room -= run.pixels * run.spp
            if room >= 0:
                self.kept[run] = self.paths.direct(run)
                pieces.append(self.paths.develop_direct(run, self.kept[run]))
            else:
                pieces.append(self.paths.develop(run))
        image, coverage = (_joined(part) for part in zip(*pieces, strict=True))
        return Rendering(
            image.view(self.view.height, self.view.width, 3), coverage.view(self.view.height, self.view.width)
        )

    def backpropagate(self, grad_image: Float[Tensor, "height width 3"]) -> Gradients:
        """The gradient of sum(image * grad_image), of the same samples."""
        maps, light = self.paths.tracer.maps, self.view.environment
        if not self.wrt:
            return Gradients(tuple({} for _ in maps.color.shapes))
        given = grad_image.detach().to(self.device, torch.float32).reshape(-1, 3)
        wait_for_torch(self.device)
        sums = Sums.of(self.paths.tracer.mi, maps, light, self.wrt)
        for run in self.runs:
            if self._direct:
                direct = self.kept.get(run) or self.paths.direct(run)
                self.paths.backpropagate_direct(run, direct, given[run.film], sums)
            else:
                self.paths.backpropagate(run, given[run.film], sums)
        return sums.gradients(maps, light.radiance.shape)

    @property
    def _direct(self) -> bool:
        return self.paths.linear and self.wrt == {"base_color"}


def _joined(pieces: Sequence[Tensor]) -> Tensor:
    return pieces[0] if len(pieces) == 1 else torch.cat(tuple(pieces))
