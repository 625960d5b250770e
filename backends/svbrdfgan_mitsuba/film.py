"""A film in runs of neighbouring pixels, of bounded memory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan_mitsuba.interop import floats, tensor
from svbrdfgan_mitsuba.jit import dr

VERTICES = {"cpu": 2**20, "cuda": 2**23}
"""Path vertices held in memory at a time, at most 100 bytes each."""


@dataclass(frozen=True)
class Run:
    """Neighbouring pixels, and how they are sampled.

    Attributes:
        first: the first pixel, row * width + column.
    """

    first: int
    pixels: int
    spp: int
    seed: int

    @property
    def film(self) -> slice:
        return slice(self.first, self.first + self.pixels)

    def mean(self, mi: Any, values: Any) -> Tensor:
        """Of each pixel's samples; the channels of a pixel together."""
        dr.eval(values)
        return tensor(dr.ravel(dr.block_sum(values, self.spp) / dr.opaque(mi.Float, self.spp)))

    def spread(self, mi: Any, grad_image: Float[Tensor, "pixels 3"]) -> Any:
        """The transpose of `mean`: what each sample has of the gradient at its pixel."""
        pixel = dr.arange(mi.UInt32, self.pixels * self.spp) // dr.opaque(mi.UInt32, self.spp)
        given = dr.gather(mi.Color3f, floats(mi, grad_image, grad_image.device), pixel)
        return given / dr.opaque(mi.Float, self.spp)


def runs(pixels: int, spp: int, seed: int, bounces: int, device: torch.device) -> list[Run]:
    """A film of so many pixels, cut into runs of at most `VERTICES` path vertices, or of one pixel."""
    size = max(1, VERTICES[device.type] // (spp * bounces))
    return [Run(first, min(size, pixels - first), spp, seed) for first in range(0, pixels, size)]
