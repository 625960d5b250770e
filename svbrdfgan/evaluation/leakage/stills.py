"""One side's clean pictures, as a discriminator sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.generate import BRIGHTEST
from svbrdfgan.training.step import Shot
from svbrdfgan.utils.copy_async import copy_async


@dataclass(frozen=True, eq=False)
class Stills:
    """One clean picture of each probed exemplar's scene, with what the discriminator sees beside it; half precision."""

    image: Float[Tensor, "pairs height width 3"]
    coverage: Float[Tensor, "pairs height width"]
    gbuffer: Float[Tensor, "pairs height width 6"] | None

    @classmethod
    def of(cls, *shots: Shot) -> Stills:
        """One after another, rounded as stored exemplars are; all have gbuffers, or none."""
        images, coverage, gbuffers = zip(*shots, strict=True)
        image = torch.cat([some.clamp(max=BRIGHTEST).half() for some in images])
        gbuffer = None if gbuffers[0] is None else torch.cat([some.half() for some in gbuffers])
        return cls(image, torch.cat([some.half() for some in coverage]), gbuffer)

    def shot(self, pairs: Sequence[int]) -> Shot:
        """Those of some pairs."""
        picked = copy_async(torch.as_tensor(pairs), self.image.device)
        return self.image[picked], self.coverage[picked], None if self.gbuffer is None else self.gbuffer[picked]
