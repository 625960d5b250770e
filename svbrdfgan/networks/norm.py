"""Norms by the names that configurations give them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

Norm = Literal["instance", "group", "none"]

EPSILON = 1e-5


def make_norm(channels: int, norm: Norm) -> nn.Module:
    makers: dict[str, Callable[[], nn.Module]] = {
        "instance": InstanceNorm,
        "group": lambda: nn.GroupNorm(min(8, channels), channels),
        "none": nn.Identity,
    }
    return makers[norm]()


class InstanceNorm(nn.Module):
    """Ulyanov et al. (2016), without affine parameters."""

    def forward(self, x: Float[Tensor, "batch channels rows cols"]) -> Float[Tensor, "batch channels rows cols"]:
        return instance_norm(x)


def instance_norm(x: Float[Tensor, "batch channels rows cols"]) -> Float[Tensor, "batch channels rows cols"]:
    """Flattened, since torch 2.13 gives a wrong gradient for one unflattened sample if that of the result is
    channels-last (seen on the CPU)."""
    return F.instance_norm(x.flatten(2), eps=EPSILON).view(x.shape)
