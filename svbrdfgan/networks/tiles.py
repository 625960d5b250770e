"""Painting in tiles: layers of any size in the memory of one tile, by generators that were trained on windows.

Such generators have local norms, so that a texel depends on those around it alone. Each tile is painted with as many
texels around it as that takes, so that tiles join without a border.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from svbrdfgan.networks.generator import NORMAL, Generator
from svbrdfgan.networks.inputs import window_of
from svbrdfgan.types import layer_channels

_TILE = 1024
"""Texels along a side of a tile, before those around it: larger ones waste less, and take more memory."""


@dataclass(frozen=True)
class Windows:
    """What a generator was trained on instead of whole maps.

    Attributes:
        size: texels along a side of a window.
        finer: how many of its texels lie along a side of one of the geometry that it is to paint on.
    """

    size: int
    finer: int = 1


@dataclass(frozen=True)
class _Span:
    """Rows or columns that are painted at once, and those of them that are kept.

    Attributes:
        start, stop: of what is painted.
        first, last: of what is kept.
    """

    start: int
    stop: int
    first: int
    last: int

    @classmethod
    def around(cls, first: int, last: int, size: int, generator: Generator) -> _Span:
        """The span of a map of that size which the generator has to see to paint this one."""
        reach = -(-generator.reach // generator.multiple) * generator.multiple
        return cls(max(first - reach, 0), min(last + reach, size), first, last)

    def place(self, factor: int) -> slice:
        """What is kept, in a map that is finer by a factor."""
        return slice(self.first * factor, self.last * factor)

    def kept(self, factor: int) -> slice:
        """What is kept, in what is painted."""
        return slice((self.first - self.start) * factor, (self.last - self.start) * factor)


def paint_in_tiles(
    generator: Generator,
    windows: Windows,
    geometry: Float[Tensor, "batch inputs rows cols"],
    seeds: Int[Tensor, " batch"] | None = None,
    labels: Float[Tensor, "batch labels"] | None = None,
    factor: int = 1,
    wanted: Bool[Tensor, "rows cols"] | None = None,
    tile: int = _TILE,
) -> Float[Tensor, "batch fine_rows fine_cols channels"]:
    """The layers that the generator paints on whole maps, `windows.finer * factor` times as fine as their geometry.

    The geometry is interpolated to the texels of the training.

    Args:
        generator: with a local norm.
        seeds, labels, factor: as for `Generator.forward`.
        wanted: texels of the geometry where the layer is needed; elsewhere it may be 0.
        tile: a multiple of the generator's `multiple`.
    """
    batch, _, *shape = geometry.shape
    rows, cols = (side * windows.finer for side in shape)
    whole = geometry.new_zeros(batch, rows * factor, cols * factor, layer_channels(generator.maps))
    refined = None if generator.refined is None else generator.refined_layers(geometry, seeds, labels)
    for down, right in _tiles(torch.ones(shape) if wanted is None else wanted, windows.finer, tile, generator):
        read = _interpolated(geometry, down, right, windows.finer)
        beneath = None if refined is None else _part_of(refined, down, right, (rows, cols))
        painted = generator(read, seeds, labels, factor, windows.size, beneath)
        whole[:, down.place(factor), right.place(factor)] = painted[:, down.kept(factor), right.kept(factor)]
    return whole


def _tiles(wanted: Tensor, finer: int, tile: int, generator: Generator) -> Iterator[tuple[_Span, _Span]]:
    """The rows and columns of tiles of a fine map, each no larger than what is wanted of it."""
    size = [side * finer for side in wanted.shape]
    step = generator.multiple
    for top, left in itertools.product(*(range(0, side, tile) for side in size)):
        corner = torch.tensor([top, left])
        part = wanted[top // finer : -(-(top + tile) // finer), left // finer : -(-(left + tile) // finer)]
        inside = part.nonzero() * finer + corner // finer * finer
        if not len(inside):
            continue
        first = torch.maximum(inside.amin(dim=0) // step * step, corner)
        last = ((inside.amax(dim=0) + finer - 1) // step + 1) * step
        last = torch.minimum(last, torch.minimum(corner + tile, torch.tensor(size)))
        down, right = (
            _Span.around(*span, side, generator)
            for span, side in zip(zip(first.tolist(), last.tolist(), strict=True), size, strict=True)
        )
        yield down, right


def _part_of(
    maps: Float[Tensor, "batch rows cols channels"], down: _Span, right: _Span, size: tuple[int, int]
) -> Float[Tensor, "batch tile_rows tile_cols channels"]:
    """The part of interpolated maps that lies in both spans of a map of that size."""
    shape = (down.stop - down.start, right.stop - right.start)
    place = [part / side for part, side in zip((down.start, right.start, *shape), 2 * size, strict=True)]
    return window_of(maps, torch.tensor([place] * len(maps), device=maps.device), *shape)


def _interpolated(
    geometry: Float[Tensor, "batch inputs rows cols"], down: _Span, right: _Span, finer: int
) -> Float[Tensor, "batch inputs tile_rows tile_cols"]:
    """The part of the interpolated geometry that lies in both spans."""
    cut, inner = [], []
    for span, size in ((down, geometry.shape[2]), (right, geometry.shape[3])):
        start, stop = max(span.start // finer - 1, 0), min(-(-span.stop // finer) + 1, size)
        cut.append(slice(start, stop))
        inner.append(slice(span.start - start * finer, span.stop - start * finer))
    part = geometry[:, :, cut[0], cut[1]]
    if finer == 1:
        return part[:, :, inner[0], inner[1]]
    fine = F.interpolate(part, scale_factor=finer, mode="bilinear")[:, :, inner[0], inner[1]]
    fine[:, NORMAL] = F.normalize(fine[:, NORMAL], dim=1)
    return fine
