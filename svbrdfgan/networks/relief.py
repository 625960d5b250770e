"""Relief: normals as the slopes of a painted height, so that they belong to a surface, and lean to no side at large."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

_LEAST = 0.5
"""Least length of a texel, over the number of texels along a side, in the units of `position`. Poles of an embedding
and texels beside the surface are shorter, and would have slopes without bound."""

_BROAD = 6
"""The mean around a texel is that of so many on either side: waves of 30 texels lose half of their height, those of 8
hardly any, and those of 100 nearly all."""
FINE_REACH = 2 * _BROAD
"""How many texels away a height may change `fine_relief`."""


def fine_relief(height: Float[Tensor, "batch rows cols"], factor: int = 1) -> Float[Tensor, "batch rows cols"]:
    """A height less the mean of the means around each texel, and so without its broad waves.

    Args:
        factor: how many times finer the texels are than those by which waves are called broad.
    """
    pad, broad = _BROAD * factor, height.unsqueeze(1)
    for _ in range(2):  # rows, then columns, which takes a sixth of the time of both at once
        broad = F.pad(broad, 4 * (pad,), mode="replicate")
        for window in ((1, 2 * pad + 1), (2 * pad + 1, 1)):
            broad = F.avg_pool2d(broad, window, stride=1)
    return height - broad.squeeze(1)


def relief_normals(
    height: Float[Tensor, "batch rows cols"], position: Float[Tensor, "batch 3 rows cols"], texels: int
) -> Float[Tensor, "batch rows cols 3"]:
    """Unit normals in tangent space of a surface that was raised by `height` (Blinn 1978), by differences of texels.

    Slopes are those along the surface, whatever the embedding stretches. Where texels that lie side by side show places
    far apart, at cuts and at the texture's border, the relief is nearly flat.

    Args:
        height: outward, in the units of `position`.
        position: of each texel.
        texels: along a side of the map.
    """
    least = _LEAST / texels
    along, up = (torch.roll(position, -1, dims=dim) - position for dim in (3, 2))
    rise, climb = (torch.roll(height, -1, dims=dim) - height for dim in (2, 1))
    length = along.norm(dim=1).clamp(min=least)
    sheared = (along * up).sum(dim=1) / length  # of `up` along the tangent
    upright = (up.square().sum(dim=1) - sheared.square()).clamp(min=least**2).sqrt()
    x = rise / length
    y = (climb - sheared * x) / upright
    return F.normalize(torch.stack([-x, -y, torch.ones_like(x)], dim=-1), dim=-1)
