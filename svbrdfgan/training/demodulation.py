"""What pictures show of a surface, with the light divided out and seen from elsewhere.

Under direct light a picture of Lambertian surfaces is background + T @ texture. So (picture - background) / (T @ 1) is
the mean reflectance of what a pixel shows of the learnable parts, each point weighted by the light that it returns; and
each row of T, divided so, says which texels those are.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.rendering.transport import TransportBatch

Image = Float[Tensor, "batch height width 3"]
Pixels = Bool[Tensor, "batch height width"]
Texture = Float[Tensor, "textures rows cols 3"]
Texels = Bool[Tensor, "textures rows cols 1"]

_DARK, _SHARE, _LARGEST = 0.02, 0.5, 1.5
_TOUCHED = 1e-4


@dataclass(frozen=True, eq=False)
class Sight:
    """What a batch of views shows of their textures: each pixel a mean of texels.

    Attributes:
        shading: the pictures of the learnable parts alone, were they white; infinite where not clear.
        clear: where reflectance can be told: at least half the pixel is learnable, and no channel of `shading` is below
            2 % of its mean over such pixels.
    """

    batch: TransportBatch
    shading: Image
    clear: Pixels

    @classmethod
    def of(cls, batch: TransportBatch) -> Sight:
        """That of these views."""
        first = batch.transports[0]
        ones = torch.ones(len(batch.owner), *first.texture_shape, 3, device=first.texel.device)
        shading = batch.linear(ones)
        clear = _clear(shading, batch.gbuffer)
        return cls(batch, torch.where(clear.unsqueeze(-1), shading, torch.inf), clear)

    def reflectance(self, image: Image) -> Image:
        """What these pictures of the views show, in [0, 1.5]; zero where it cannot be told. Differentiable."""
        return ((image.float() - self.batch.background) / self.shading).clamp(0.0, _LARGEST)

    def lifted(self, reflectance: Image, clear: Pixels) -> tuple[Texture, Texels]:
        """The texture that clear pixels show, each texel the mean of those that show it; and where they show any."""
        share = clear.unsqueeze(-1) / self.shading
        weight = self.batch.transposed(share)
        touched = (weight > _TOUCHED).all(dim=-1, keepdim=True)
        texture = self.batch.transposed(reflectance * share) / torch.where(touched, weight, torch.inf)
        return texture, touched

    def projected(self, texture: Texture, touched: Texels) -> tuple[Image, Pixels]:
        """How these views see a texture that is known in places, and where half of what they see of it is."""
        share = self.batch.linear(touched.expand_as(texture).float()) / self.shading
        clear = (share > _SHARE).all(dim=-1)
        return self.batch.linear(texture) / self.shading / torch.where(clear.unsqueeze(-1), share, torch.inf), clear


def carried(reflectance: Image, clear: Pixels, *path: Sight) -> tuple[Image, Pixels]:
    """What pictures of the first views show, as seen from the next and so on, each time through the texture.

    Every step blurs by about a pixel of the views that it leads between, and leaves what both of them see.
    """
    for here, there in pairwise(path):
        reflectance, clear = there.projected(*here.lifted(reflectance, clear))
    return reflectance, clear


def _clear(shading: Image, gbuffer: Float[Tensor, "batch height width 6"]) -> Pixels:
    """By the G-buffer of the same views: its normal is at most as long as the learnable share of a pixel."""
    learnable = (gbuffer[..., 3:].norm(dim=-1) >= _SHARE).unsqueeze(-1)
    count = learnable.sum(dim=(1, 2), keepdim=True).clamp(min=1)
    mean = (shading * learnable).sum(dim=(1, 2), keepdim=True) / count
    return (shading > _DARK * mean).all(dim=-1) & learnable.squeeze(-1)
