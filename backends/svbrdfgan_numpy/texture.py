"""One map of all the parts of a surface, as one list of texels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import Materials
from svbrdfgan.types.material import CHANNELS
from svbrdfgan_numpy.taps import Taps, bilinear_taps


@dataclass(frozen=True, eq=False)
class Texture:
    """The texels of every part, one part after the other. A constant is a texture of one texel.

    Attributes:
        texels: their values.
        shapes: of each part's map: (channels,) or (rows, cols, channels); no rows where the part has no such map.
        repeat: whether to repeat along u and along v, instead of clamping.
    """

    texels: Float[ndarray, "texels channels"]
    shapes: tuple[torch.Size, ...]
    repeat: tuple[bool, bool]

    def taps(self, part: Int[ndarray, " points"], uv: Float[ndarray, "points 2"]) -> Taps:
        """What each point reads; its part must have the map."""
        rows, cols = np.array([shape[:-1] or (1, 1) for shape in self.shapes]).T
        first = np.cumsum(rows * cols) - rows * cols
        taps = bilinear_taps(uv, rows[part], cols[part], self.repeat)
        return Taps(first[part, None] + taps.index, taps.weight)

    def split(self, gradient: Float[ndarray, "texels channels"]) -> list[Float[Tensor, "*shape"]]:
        """The gradient of each part's map, float32 and shaped as that map."""
        sizes = [shape.numel() // shape[-1] for shape in self.shapes]
        pieces = torch.from_numpy(gradient).float().split(sizes)
        return [piece.reshape(shape) for piece, shape in zip(pieces, self.shapes, strict=True)]


def texture_of(materials: Materials, name: str, repeat: tuple[bool, bool]) -> Texture:
    """A map of every part that has it."""
    missing = torch.empty(0, 0, CHANNELS[name])
    maps = [material.maps.get(name, missing).detach().cpu().double() for material in materials.parts]
    texels = torch.cat([values.reshape(-1, CHANNELS[name]) for values in maps])
    return Texture(texels.numpy(), tuple(values.shape for values in maps), repeat)
