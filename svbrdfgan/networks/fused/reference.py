"""What stands between two convolutions, norm, ReLU or sum, upsampling, padding by reflection: by torch's operations."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.norm import instance_norm


@dataclass(frozen=True)
class Prologue:
    """reflect_pad(upsample(relu(norm(x)) + residual)), of which any part may be left out.

    Attributes:
        norm: instance norm (Ulyanov et al. 2016), without affine parameters.
        upsample: the factor, 1 or 2; the nearest value is repeated.
        pad: rows and columns added on each side, fewer than there are.
    """

    norm: bool = False
    relu: bool = False
    upsample: int = 1
    pad: int = 0


class Features(NamedTuple):
    """A prologue's result.

    Attributes:
        padded: for the convolution.
        features: the same before upsampling and padding, for a residual. It may be a view of the padded ones.
    """

    padded: Float[Tensor, "batch channels padded_rows padded_cols"]
    features: Float[Tensor, "batch channels rows cols"]


def plain(x: Tensor, how: Prologue, residual: Tensor | None = None) -> Features:
    """By torch's own operations."""
    features = instance_norm(x) if how.norm else x
    if how.relu:
        features = F.relu(features, inplace=how.norm)
    if residual is not None:
        features = residual + features
    padded = F.interpolate(features, scale_factor=how.upsample) if how.upsample > 1 else features
    if how.pad:
        padded = F.pad(padded, (how.pad,) * 4, mode="reflect")
    return Features(padded, features)
