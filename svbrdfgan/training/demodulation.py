"""Demodulation: what pictures show of a surface, with the light divided out, seen from any camera.

Under direct light a picture of Lambertian surfaces is background + T @ texture, where T is the light transport. So
(picture - background) / (T @ 1) is the mean reflectance of the learnable surface in a pixel, each point weighted by the
light that it returns. The rows of T, divided by T @ 1, are the weights of the texels in that mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from svbrdfgan.data.reflectance_errors import MAX_REFLECTANCE
from svbrdfgan.rendering.transport.product import TransportBatch

Image = Float[Tensor, "batch height width 3"]
Pixels = Bool[Tensor, "batch height width"]
Texture = Float[Tensor, "textures rows cols 3"]
Texels = Bool[Tensor, "textures rows cols 1"]

_DARKEST = 0.02
"""Shading below this share of the picture's mean is not divided by: the quotient would be noise."""
_LEAST_SHARE = 0.5
"""Least learnable share of a pixel, and least known share of its texels, for which its reflectance is given."""
_LEAST_WEIGHT = 1e-4
"""Texels with less weight in all pixels together count as not seen."""


@dataclass(frozen=True, eq=False)
class Demodulator:
    """Divides the light out of pictures of a batch of views.

    Attributes:
        shading: pictures of the learnable parts alone, painted white; infinite where `clear` is false.
        clear: pixels whose reflectance can be given: at least half the pixel is learnable, and no channel of `shading`
            is below 2 % of its mean over such pixels.
    """

    batch: TransportBatch
    shading: Image
    clear: Pixels

    @classmethod
    def of(cls, batch: TransportBatch) -> Demodulator:
        """The demodulator of these views."""
        first = batch.transports[0]
        ones = torch.ones(len(batch.owner), *first.texture_shape, 3, device=first.texel.device)
        shading = batch.linear(ones)
        clear = _clear(shading, batch.gbuffer)
        return cls(batch, torch.where(clear.unsqueeze(-1), shading, torch.inf), clear)

    def reflectance(self, image: Image) -> Image:
        """Mean reflectance per pixel of these views' pictures, in [0, 1.5]; 0 where not `clear`. Differentiable."""
        return ((image.float() - self.batch.background) / self.shading).clamp(0.0, MAX_REFLECTANCE)

    def scatter_to_texture(self, reflectance: Image, clear: Pixels) -> tuple[Texture, Texels]:
        """The texture that clear pixels show, each texel the mean of its pixels; and which texels are seen."""
        share = clear.unsqueeze(-1) / self.shading
        weight = self.batch.transposed(share)
        seen = (weight > _LEAST_WEIGHT).all(dim=-1, keepdim=True)
        texture = self.batch.transposed(reflectance * share) / torch.where(seen, weight, torch.inf)
        return texture, seen

    def gather_from_texture(self, texture: Texture, seen: Texels) -> tuple[Image, Pixels]:
        """Shows a texture that is known in places in these views; and the pixels of which at least half is known."""
        share = self.batch.linear(seen.expand_as(texture).float()) / self.shading
        clear = (share > _LEAST_SHARE).all(dim=-1)
        return self.batch.linear(texture) / self.shading / torch.where(clear.unsqueeze(-1), share, torch.inf), clear


def reproject(reflectance: Image, clear: Pixels, *path: Demodulator) -> tuple[Image, Pixels]:
    """Moves what pictures of the first views show to the next views and so on, each time through the texture.

    Every step blurs by about a pixel of the views that it leads between, and keeps what both of them see.
    """
    for here, there in pairwise(path):
        reflectance, clear = there.gather_from_texture(*here.scatter_to_texture(reflectance, clear))
    return reflectance, clear


def _clear(shading: Image, gbuffer: Float[Tensor, "batch height width 6"]) -> Pixels:
    # The G-buffer is premultiplied by the learnable share of a pixel, so its normal is at most that long.
    learnable = (gbuffer[..., 3:].norm(dim=-1) >= _LEAST_SHARE).unsqueeze(-1)
    count = learnable.sum(dim=(1, 2), keepdim=True).clamp(min=1)
    mean = (shading * learnable).sum(dim=(1, 2), keepdim=True) / count
    return (shading > _DARKEST * mean).all(dim=-1) & learnable.squeeze(-1)
