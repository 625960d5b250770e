"""The fused operation by torch's own: what runs without Triton, and what the kernels are tested against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.layers import instance_norm

Affine: TypeAlias = Float[Tensor, "batch 2 channels"]
"""A scale and a shift for each sample and channel."""


@dataclass(frozen=True)
class NormActPad:
    """reflect_pad(upsample(relu(affine(norm(x))) + residual)); every part is optional.

    Attributes:
        norm: instance norm (Ulyanov et al. 2016). Each sample may have affine parameters of its own.
        upsample: nearest-neighbour factor, 1 or 2.
        pad: rows and columns added on each side by reflection, fewer than there are.
    """

    norm: bool = False
    relu: bool = False
    upsample: int = 1
    pad: int = 0


class Features(NamedTuple):
    """The result of a `NormActPad`.

    Attributes:
        padded: the input of the next convolution.
        features: the values before upsampling and padding, for a skip connection; possibly a view of `padded`.
    """

    padded: Float[Tensor, "batch channels padded_rows padded_cols"]
    features: Float[Tensor, "batch channels rows cols"]


def norm_act_pad_reference(
    x: Tensor, spec: NormActPad, residual: Tensor | None = None, affine: Affine | None = None
) -> Features:
    """The result of `norm_act_pad`, differentiable any number of times."""
    features = instance_norm(x) if spec.norm else x
    if affine is not None:
        scale, shift = affine[..., None, None].to(features.dtype).unbind(dim=1)
        features = torch.addcmul(shift, features, scale)
    if spec.relu:
        own = spec.norm or affine is not None  # without them it would overwrite the caller's x
        features = F.relu(features, inplace=own)
    if residual is not None:
        features = residual + features
    padded = F.interpolate(features, scale_factor=spec.upsample) if spec.upsample > 1 else features
    if spec.pad:
        padded = F.pad(padded, (spec.pad,) * 4, mode="reflect")
    return Features(padded, features)
