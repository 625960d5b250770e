"""One picture, from its camera samples to its pixels, and from the pixels' gradient back to what they depend on."""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import dataclass, field

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Rendering, View
from svbrdfgan_warp import lookup, textures
from svbrdfgan_warp.adjoint import Adjoint
from svbrdfgan_warp.device import in_order, launch
from svbrdfgan_warp.records import Records, Run, Tracer

KEPT = {"cpu": 2**22, "cuda": 2**26}
"""Camera samples whose records are kept for a gradient, at most; what is beyond is traced again."""


@dataclass(frozen=True, eq=False)
class Shot:
    """What a picture is made of.

    Attributes:
        runs: its camera samples.
        texels: base colours of all parts, as they were when the shot was made.
        kept: records that need not be traced again.
    """

    tracer: Tracer
    view: View
    runs: list[Run]
    materials: Materials
    atlas: lookup.Atlas
    texels: Float[Tensor, "texels 3"]
    kept: dict[Run, Records] = field(default_factory=dict)

    @classmethod
    def of(cls, tracer: Tracer, view: View, runs: list[Run], materials: Materials) -> Shot:
        surface = tracer.surface
        atlas = textures.atlas(textures.shapes(materials), surface.repeat, surface.device)
        return cls(tracer, view, runs, materials, atlas, textures.pack(materials, surface.device))

    def develop(self, *, keep: bool = False) -> Rendering:
        """The picture. Unless records are kept, it takes no more memory than itself, the inputs and one run."""
        device, height, width = self.texels.device, self.view.height, self.view.width
        image = torch.empty(height * width, 3, dtype=torch.float32, device=device)
        coverage = torch.empty(height * width, dtype=torch.float32, device=device)
        texels, results = wp.from_torch(self.texels, wp.vec3), (wp.from_torch(image, wp.vec3), wp.from_torch(coverage))

        def develop(run: Run) -> Records:
            records = self.tracer(run)
            launch(lookup.gather, run.pixels, (self.atlas, *records.arguments(), texels, *results), device)
            return records

        room = KEPT[device.type] if keep else 0
        for records in in_order(develop, self.runs, device):
            room -= len(records.run)
            if room >= 0:
                self.kept[records.run] = records
        return Rendering(image.view(height, width, 3), coverage.view(height, width))

    def backpropagate(self, grad_image: Float[Tensor, "height width 3"], wrt: Set[str]) -> Gradients:
        """The gradient of sum(image * grad_image): the transpose of `develop` on the same samples."""
        adjoint = Adjoint.of(self.atlas, self.texels, self.view, grad_image, wrt)
        for records in self._records() if wrt else ():
            adjoint.add(records)
        return adjoint.gradients(self.materials)

    def _records(self) -> Iterator[Records]:
        yield from self.kept.values()
        yield from in_order(self.tracer, [run for run in self.runs if run not in self.kept], self.texels.device)
