"""Parts of both networks: norms by their configured names, and the initial weights."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

Norm = Literal["instance", "group", "pixel", "none"]
LOCAL_NORMS = ("pixel", "none")
"""Those under which a texel does not depend on others, so that any part of a map can be painted alone."""

EPSILON = 1e-5
"""Added to the variance of an instance norm, as torch does: a constant channel has none."""


def make_norm(channels: int, norm: Norm) -> nn.Module:
    makers: dict[str, Callable[[], nn.Module]] = {
        "instance": InstanceNorm,
        "group": lambda: nn.GroupNorm(min(8, channels), channels),
        "pixel": PixelNorm,
        "none": nn.Identity,
    }
    return makers[norm]()


class InstanceNorm(nn.Module):
    """Ulyanov et al. (2016), without affine parameters."""

    def forward(self, x: Float[Tensor, "batch channels rows cols"]) -> Float[Tensor, "batch channels rows cols"]:
        return instance_norm(x)


class PixelNorm(nn.Module):
    """Karras et al. (2018): the channels of each pixel have mean square 1."""

    def forward(self, x: Float[Tensor, "batch channels rows cols"]) -> Float[Tensor, "batch channels rows cols"]:
        return x * torch.rsqrt(x.float().square().mean(dim=1, keepdim=True) + EPSILON).to(x.dtype)


def instance_norm(x: Float[Tensor, "batch channels rows cols"]) -> Float[Tensor, "batch channels rows cols"]:
    # flattened, since torch 2.13 returns a wrong gradient for a batch of one whose incoming gradient is channels-last
    # (seen on the CPU)
    return F.instance_norm(x.flatten(2), eps=EPSILON).view(x.shape)


Weights = Literal["normal", "he"]


def initialise(network: nn.Module, generator: torch.Generator, weights: Weights = "normal") -> None:
    """Draws the first weights, and zeroes biases.

    Args:
        weights: of convolutions. "normal": from N(0, 0.02), as the thesis's code base does where the thesis is silent.
            "he": so that they keep the size of their input (He et al. 2015), as those of linear layers, which the
            thesis does not have, always do.
    """
    for module in network.modules():
        if not isinstance(module, nn.Conv2d | nn.ConvTranspose2d | nn.Linear):
            continue
        if weights == "normal" and not isinstance(module, nn.Linear):
            nn.init.normal_(module.weight, 0.0, 0.02, generator=generator)
        else:
            nn.init.kaiming_normal_(module.weight, 0.2, generator=generator)
        if module.bias is not None:
            nn.init.zeros_(module.bias)
