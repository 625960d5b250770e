"""One draw of a generator: a function of geometry alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.generator import Generator


@dataclass(frozen=True, eq=False)
class Draw:
    """A generator whose seed and labels are fixed.

    Attributes:
        seed: of the random fields, if the generator has any; at least 0.
        labels: what is wanted of the layer, as many numbers as the generator reads.
    """

    generator: Generator
    seed: int = 0
    labels: Sequence[float] = ()

    def __call__(
        self, geometry: Float[Tensor, "batch inputs rows cols"], factor: int = 1
    ) -> Float[Tensor, "batch fine_rows fine_cols channels"]:
        """The layer of this seed and these labels on each geometry, `factor` times as fine as it."""
        count, device = len(geometry), geometry.device
        seeds = torch.full((count,), self.seed, dtype=torch.int64, device=device)
        labels = torch.tensor([list(self.labels)] * count, dtype=torch.float32, device=device)
        layers: Tensor = self.generator(geometry, seeds, labels, factor)
        return layers
