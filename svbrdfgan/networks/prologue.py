"""What stands between two convolutions, as one operation: norm, ReLU or sum, upsampling, padding by reflection.

On CUDA with Triton it is a few kernels that read and write channels-last memory, and write the padded values alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.norm import instance_norm
from svbrdfgan.triton_works import triton_works

_HANDLED = (torch.float32, torch.bfloat16, torch.float16)


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


def prologue(
    x: Float[Tensor, "batch channels rows cols"],
    how: Prologue,
    residual: Float[Tensor, "batch channels rows cols"] | None = None,
) -> Features:
    """Differentiable once where kernels work; the result is then of autocast's precision and not to be changed."""
    if x.device.type != "cuda" or not _fits(x, how) or not triton_works(x.device):
        return plain(x, how, residual)
    from svbrdfgan.networks.fused_prologue import fused

    return fused(x, how, residual)


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


def _fits(x: Tensor, how: Prologue) -> bool:
    """Whether kernels do it: in at most single precision, with borders whose mirror images lie apart."""
    return x.dtype in _HANDLED and min(x.shape[-2:]) * how.upsample > 2 * how.pad + 1
