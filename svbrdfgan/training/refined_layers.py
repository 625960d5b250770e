"""What a generator refines: layers of whole maps, painted once for some seeds of each exemplar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs, window_of
from svbrdfgan.utils.copy_async import copy_async

SEEDS = 4
"""Of each exemplar, so thousands of a data set: enough that networks cannot know them by heart. To paint more takes
long: with sixteen, most of the first two minutes of a training on an H200."""
_MOST_BYTES = 2 << 30
_AROUND = 3
"""Texels around a window that bicubic interpolation may read, and one for windows that begin within a texel."""
_Side = TypeVar("_Side", int, Tensor)
_Part = tuple[Float[Tensor, "rows cols channels"], Float[Tensor, " 4"]]
"""Of a whole map around a window, and the window's place in it, as in `Wholes`."""


def kept_bytes(exemplars: int, side: int, channels: int) -> int:
    """Bytes that are kept at most.

    Args:
        side: texels of the whole map along a side of a window.
    """
    return min(_MOST_BYTES, exemplars * SEEDS * 2 * channels * _read(side) ** 2)


class RefinedLayers:
    """The layers that a generator refines, in the windows of exemplars.

    They never change, and to paint a whole map takes about as long as a step on its window. So each exemplar has a few
    seeds alone, and what its window needs is kept when a seed is first drawn, up to some bytes in half precision.

    Args:
        generator: one that refines layers.
        most_bytes: that are kept; what does not fit is painted again each time.
    """

    def __init__(self, generator: Generator, most_bytes: int = _MOST_BYTES) -> None:
        self._generator = generator
        self._kept: dict[int, _Part] = {}
        self._left = most_bytes

    def draw(self, indices: Sequence[int], rng: np.random.Generator) -> list[int]:
        """A seed for each of these exemplars."""
        drawn = rng.integers(SEEDS, size=len(indices)).tolist()
        return [SEEDS * index + number for index, number in zip(indices, drawn, strict=True)]

    def windows(
        self, inputs: Inputs, seeds: Sequence[int], labels: Float[Tensor, "batch labels"] | None
    ) -> Float[Tensor, "batch rows cols channels"]:
        """What is refined in the windows of exemplars.

        Args:
            inputs: of the windows, with wholes.
            seeds: as drawn for the exemplars.
            labels: of the exemplars.
        """
        rows, cols = inputs.geometry.shape[2:]
        parts = [self._part(inputs, number, seed, labels) for number, seed in enumerate(seeds)]
        values, places = zip(*parts, strict=True)
        return window_of(torch.stack(values).float(), torch.stack(places), rows, cols)

    def _part(self, inputs: Inputs, number: int, seed: int, labels: Tensor | None) -> _Part:
        """Of one exemplar. What is painted does not depend on the batch, so that resumed runs go on as others do."""
        if seed in self._kept:
            return self._kept[seed]
        wholes, one = inputs.wholes, slice(number, number + 1)
        assert wholes is not None
        told = None if labels is None else labels[one]
        seeds = torch.tensor([seed], device=inputs.device)
        whole = self._generator.refined_layers(wholes.geometry[wholes.of[one]], seeds, told)
        part = _cut(whole[0], wholes.place[number])
        if part[0].nbytes <= self._left:
            self._left -= part[0].nbytes
            self._kept[seed] = part
        return part


def _read(side: _Side) -> _Side:
    """Texels along a side of what is kept of a window with so many."""
    return side + 2 * _AROUND + 1


def _cut(whole: Float[Tensor, "rows cols channels"], place: Float[Tensor, " 4"]) -> _Part:
    """What `window_of` reads of a whole map, and the window's place in that."""
    sides = torch.tensor(whole.shape[:2])
    first, size = (sides * place.double().cpu().reshape(2, 2)).unbind()
    count = torch.minimum(_read(size.ceil().long()), sides)
    start = torch.minimum((first.floor().long() - _AROUND).clamp(min=0), sides - count)
    (top, left), (rows, cols) = start.tolist(), count.tolist()
    inner = torch.cat([(first - start) / count, size / count]).float()
    return whole[top : top + rows, left : left + cols].half(), copy_async(inner, whole.device)
