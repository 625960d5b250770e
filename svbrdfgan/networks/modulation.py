"""Modulation: how a code that belongs to a whole layer, such as its amount, acts on the generator's features."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

_HIDDEN = 128  # width of the MLP's two hidden layers


class Affine:
    """A scale and a shift for each sample and channel.

    Attributes:
        scale, shift: 1 and 0 change nothing.
    """

    def __init__(self, values: Float[Tensor, "batch twice_channels"]) -> None:
        scale, shift = values[..., None, None].chunk(2, dim=1)
        self.scale, self.shift = 1.0 + scale, shift

    def __call__(self, x: Float[Tensor, "batch channels rows cols"]) -> Float[Tensor, "batch channels rows cols"]:
        return torch.addcmul(self.shift.to(x.dtype), x, self.scale.to(x.dtype))


class Modulation(nn.Module):
    """An MLP from a code to an `Affine` for each of several convolutions (FiLM; Perez et al. 2018).

    Before training, modulation changes nothing. An instance norm removes whatever is constant over a texture, so a code
    that came in as planes next to the geometry would be lost; a scale of features is not, since each convolution mixes
    channels. A shift is, but for the last convolution, whose result has no norm.

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
        return [Affine(part) for part in values.split(self.sizes, dim=1)]


def _leaky_relu() -> nn.Module:
    return nn.LeakyReLU(0.2)
