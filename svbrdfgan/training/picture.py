"""Pictures as the discriminator sees them."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.rendering.compositing import over

_CONTRAST = 10.0


def present(
    image: Float[Tensor, "batch height width 3"],
    coverage: Float[Tensor, "batch height width"],
    background: Float[Tensor, "batch 3"],
    gbuffer: Float[Tensor, "batch height width 6"] | None,
) -> Float[Tensor, "batch channels height width"]:
    """Tone-mapped to about [-1, 1] before a plain background, with position and normal behind the colours if given.

    Real and fake get the same background, so that neither it nor the noise of the environment tells them apart.
    The tone curve is log(1 + 10 x) / log 11: 0 to -1, 1 to 1, smooth and never flat: highlights keep a gradient.
    """
    picture = over(image.float(), coverage.float(), background[:, None, None, :])
    channels = torch.log1p(_CONTRAST * picture.clamp(min=0)) * (2 / math.log1p(_CONTRAST)) - 1
    if gbuffer is not None:
        channels = torch.cat([channels, gbuffer.float()], dim=-1)
    return channels.permute(0, 3, 1, 2)
