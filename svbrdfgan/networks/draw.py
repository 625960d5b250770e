"""One draw of a generator: a function of geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.generator import Generator

_FAINT = 0.05


@dataclass(frozen=True, eq=False)
class Draw:
    """A generator whose seed and labels are fixed.

    Attributes:
        seed: of the random fields, if the generator has any; at least 0.
        labels: what is wanted of the layer, as many numbers as the generator reads.
        opacity: what its alpha is multiplied by; see `opacity_of`.
    """

    generator: Generator
    seed: int = 0
    labels: Sequence[float] = ()
    opacity: float = 1.0

    def __call__(
        self, geometry: Float[Tensor, "batch inputs rows cols"], factor: int = 1
    ) -> Float[Tensor, "batch fine_rows fine_cols channels"]:
        """The layer of this seed and these labels on each geometry, `factor` times as fine as it."""
        count, device = len(geometry), geometry.device
        seeds = torch.full((count,), self.seed, dtype=torch.int64, device=device)
        labels = torch.tensor([list(self.labels)] * count, dtype=torch.float32, device=device)
        layers: Tensor = self.generator(geometry, seeds, labels, factor)
        if self.opacity < 1.0:
            layers[..., self.generator.channels["alpha"]] *= self.opacity
        return layers


def opacity_of(amount: float) -> float:
    """What the alpha of a layer of this amount is multiplied by: 1 from 0.05 on, and 0 at 0, which is clean.

    A generator still paints a little at 0, which few exemplars show.
    """
    return min(1.0, amount / _FAINT)
