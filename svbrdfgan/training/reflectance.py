"""Pictures with the light divided out, which the discriminator may see in place of radiance.

Under direct light a picture of Lambertian surfaces is background + T @ texture. So (picture - background) / (T @ 1) is
the mean reflectance of what a pixel shows of the learnable parts, each point weighted by the light that it returns.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

_DARK, _SHARE, _LARGEST = 0.02, 0.5, 1.5


@dataclass(frozen=True, eq=False)
class Illumination:
    """How scenes are lit, as seen in each pixel.

    Attributes:
        white: the pictures of the learnable parts alone, were they white.
        background: those of all else.
        clear: where reflectance can be told: at least half the pixel is learnable, and no channel of `white` is darker
            than 2 % of its mean over such pixels.
    """

    white: Float[Tensor, "batch height width 3"]
    background: Float[Tensor, "batch height width 3"]
    clear: Bool[Tensor, "batch height width"]

    @classmethod
    def of(
        cls,
        white: Float[Tensor, "batch height width 3"],
        background: Float[Tensor, "batch height width 3"],
        guide: Float[Tensor, "batch height width 6"],
    ) -> Illumination:
        """From the guide of the same scenes: its normal is at most as long as the learnable share of a pixel."""
        learnable = (guide[..., 3:].norm(dim=-1) >= _SHARE).unsqueeze(-1)
        count = learnable.sum(dim=(1, 2), keepdim=True).clamp(min=1)
        mean = (white * learnable).sum(dim=(1, 2), keepdim=True) / count
        bright = (white > _DARK * mean).all(dim=-1)
        return cls(white, background, bright & learnable.squeeze(-1))

    def reflectance(self, image: Float[Tensor, "batch height width 3"]) -> Float[Tensor, "batch height width 3"]:
        """What these pictures of the scenes show, in [0, 1.5]; zero where it cannot be told. Differentiable."""
        clear = self.clear.unsqueeze(-1)
        quotient = (image.float() - self.background) / torch.where(clear, self.white, 1.0)
        return quotient.clamp(0.0, _LARGEST) * clear
