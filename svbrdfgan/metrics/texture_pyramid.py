"""Layers over the scored surface of a texture, octave by octave: Haar details that are weighted by surface area.

Pooling is over blocks of 2x2 texels, so values never come from texels that are not scored, and the powers of all
octaves add up to the variance over the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from svbrdfgan.types import CHANNELS, Layer, channel_slices

_COARSEST = 4  # least side in texels of the coarsest means


@dataclass(frozen=True, eq=False)
class Octave:
    """An octave of a stack of textures; at octave n, a texel covers 2^n x 2^n of the finest.

    Attributes:
        values: means over the surface of each texel.
        detail: `values` minus their mean over the block of 2x2 texels that they are in; zero outside the surface.
        band: likewise minus the mean of 4x4 texels, so two octaves.
        weight: surface area of each texel.
    """

    values: Float[Tensor, "draws channels rows cols"]
    detail: Float[Tensor, "draws channels rows cols"]
    band: Float[Tensor, "draws channels rows cols"]
    weight: Float[Tensor, "rows cols"]

    def power(self) -> Float[Tensor, " channels"]:
        """Mean over draws and surface of the squared detail."""
        return (self.detail.square() * (self.weight / self.weight.sum())).sum(dim=(2, 3)).mean(dim=0)

    def blocks(self) -> tuple[Float[Tensor, "draws blocks values"], Float[Tensor, " blocks"]]:
        """The band in each block of 2x2 texels that are all scored, and the block's area."""
        weight = F.pixel_unshuffle(self.weight[None], 2)
        whole = (weight > 0).all(dim=0)
        return F.pixel_unshuffle(self.band, 2)[:, :, whole].transpose(1, 2), weight.sum(dim=0)[whole]


def premultiplied(draws: Layer) -> Float[Tensor, "draws values rows cols"]:
    """Alpha, then every map times alpha: what the layer adds to any base material. Of a normal, x and y."""
    values, places = draws.values.float().permute(0, 3, 1, 2), channel_slices(draws.maps)
    alpha = values[:, places.pop("alpha")]
    maps = [values[:, place][:, : premultiplied_values(name)] for name, place in places.items()]
    return torch.cat([alpha, *(alpha * each for each in maps)], dim=1)


def premultiplied_values(name: str) -> int:
    """The number of a map's values that `premultiplied` gives."""
    return 2 if name == "normal" else CHANNELS[name]


def octave_count(rows: int, cols: int) -> int:
    """The number of times that a texture can be halved, so that its coarsest means have at least 4 texels a side."""
    count, side = 0, min(rows, cols)
    while rows % 2 == cols % 2 == 0 and side >= 2 * _COARSEST:
        rows, cols, side, count = rows // 2, cols // 2, side // 2, count + 1
    return count


def octaves(values: Float[Tensor, "draws channels rows cols"], weight: Float[Tensor, "rows cols"]) -> list[Octave]:
    """The octaves of a stack, finest first."""
    means, weights = [values], [weight]
    for _ in range(octave_count(*weight.shape)):
        means.append(pooled(means[-1], weights[-1]))
        weights.append(_sums(weights[-1]))
    made = []
    for n in range(len(means) - 1):
        inside, higher = weights[n] > 0, means[min(n + 2, len(means) - 1)]
        detail = torch.where(inside, means[n] - _enlarged(means[n + 1], weights[n]), 0.0)
        band = torch.where(inside, means[n] - _enlarged(higher, weights[n]), 0.0)
        made.append(Octave(means[n], detail, band, weights[n]))
    return made


def pooled(
    values: Float[Tensor, "draws channels rows cols"], weight: Float[Tensor, "rows cols"]
) -> Float[Tensor, "draws channels half_rows half_cols"]:
    """Means over the surface in blocks of 2x2 texels; zero where there is none."""
    return _sums(values * weight) / _sums(weight).clamp(min=1e-30)


def patch_areas(
    part: Int[Tensor, "rows cols"], weight: Float[Tensor, "rows cols"], side: int
) -> list[Float[Tensor, " patches"]]:
    """The area at the centre of each patch of side x side texels, for each octave, in `F.unfold`'s order.

    It is zero unless all texels of the patch are scored surface of one part.
    """
    found, middle = [], side // 2
    alike, scored = part.float()[None, None], weight > 0
    for _ in range(octave_count(*weight.shape)):
        pure = _alike(alike, scored, side, 1)
        centres = weight[middle : middle + pure.shape[0], middle : middle + pure.shape[1]]
        found.append((centres * pure).flatten())
        scored, alike, weight = _alike(alike, scored, 2, 2), F.max_pool2d(alike, 2), _sums(weight)
    return found


def _alike(part: Tensor, scored: Bool[Tensor, "rows cols"], side: int, stride: int) -> Bool[Tensor, "rows cols"]:
    """Whether all texels of each window are scored and of one part."""
    most, least = (sign * F.max_pool2d(sign * part, side, stride)[0, 0] for sign in (1, -1))
    missing = F.max_pool2d((~scored).float()[None, None], side, stride)[0, 0]
    return (most == least) & (missing == 0)


def _sums(values: Float[Tensor, "*batch rows cols"]) -> Float[Tensor, "*batch half_rows half_cols"]:
    """Sums over blocks of 2x2."""
    return values.unflatten(-1, (-1, 2)).unflatten(-3, (-1, 2)).sum(dim=(-3, -1))


def _enlarged(values: Tensor, like: Tensor) -> Tensor:
    return F.interpolate(values, size=like.shape, mode="nearest")
