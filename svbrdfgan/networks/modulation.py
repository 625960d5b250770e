"""Modulation: how a code that belongs to a whole layer, such as its amount, acts on the generator's features."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from svbrdfgan.networks.fused import Affine

_HIDDEN = 128  # width of the MLP's two hidden layers


class Modulation(nn.Module):
    """An MLP from a code to an `Affine` for each of several convolutions (FiLM; Perez et al. 2018).

    Before training, modulation changes nothing. An instance norm removes whatever is constant over a texture, so a code
    that came in as planes next to the geometry would be lost. Scale and shift follow the norm, as its affine parameters
    (Huang and Belongie 2017), and precede the activation.

    Args:
        code: numbers in the code.
        channels: inputs of each convolution.
    """

    def __init__(self, code: int, channels: Sequence[int]) -> None:
        super().__init__()
        self.sizes = [2 * count for count in channels]
        self.mapping = nn.Sequential(
            nn.Linear(code, _HIDDEN), _leaky_relu(), nn.Linear(_HIDDEN, _HIDDEN), _leaky_relu()
        )
        # parameters rather than a layer: `initialise` draws the weights of layers, and these start at zero
        self.weight = nn.Parameter(torch.zeros(sum(self.sizes), _HIDDEN))
        self.bias = nn.Parameter(torch.zeros(sum(self.sizes)))

    def forward(self, code: Float[Tensor, "batch code"]) -> list[Affine]:
        values = F.linear(self.mapping(code), self.weight, self.bias)
        identity = values.new_tensor([[1.0], [0.0]])
        return [part.unflatten(1, (2, -1)) + identity for part in values.float().split(self.sizes, dim=1)]


def _leaky_relu() -> nn.Module:
    return nn.LeakyReLU(0.2)
