"""Textures as flat lists of texels, and bilinear lookups as sparse linear maps.

The adjoint of a lookup is the transpose of the same map, so gradients and pictures cannot disagree.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import CHANNELS, Materials


@dataclass(frozen=True, eq=False)
class Taps:
    """The texels that each point reads, and their weights.

    Attributes:
        index: into a flat list of texels.
        weight: of each of these texels.
    """

    index: Int[ndarray, "points taps"]
    weight: Float[ndarray, "points taps"]

    def apply(self, texels: Float[ndarray, "texels channels"]) -> Float[ndarray, "points channels"]:
        """The weighted sum of its texels at each point."""
        return np.einsum("pt,ptc->pc", self.weight, texels[self.index])

    def scaled(self, factor: Float[ndarray, " points"]) -> Taps:
        """The same lookups, each point's result multiplied by its factor."""
        return Taps(self.index, self.weight * factor[:, None])

    def transpose(self, values: Float[ndarray, "points channels"], texels: int) -> Float[ndarray, "texels channels"]:
        """The values at the points, scattered to the texels: the transpose of `apply`."""
        index = self.index.ravel()
        scattered = [np.bincount(index, (self.weight * v[:, None]).ravel(), minlength=texels) for v in values.T]
        return np.stack(scattered, axis=-1, dtype=np.float64)  # without points, bincount returns int64


@dataclass(frozen=True, eq=False)
class Lookup:
    """The lookup of a map where points have it.

    Attributes:
        points: indices of these points.
        taps: their lookups.
    """

    points: Int[ndarray, " some"]
    taps: Taps


@dataclass(frozen=True, eq=False)
class Texture:
    """One map of every part, the parts' texels one after the other. A constant is a texture of one texel.

    Attributes:
        texels: their values.
        shapes: of each part's map: (channels,) or (rows, cols, channels); no rows where the part has no such map.
        repeat: whether to repeat along u and along v, instead of clamping.
    """

    texels: Float[ndarray, "texels channels"]
    shapes: tuple[torch.Size, ...]
    repeat: tuple[bool, bool]

    @classmethod
    def of(cls, materials: Materials, name: str, repeat: tuple[bool, bool]) -> Texture:
        """The map of this name of every part that has it."""
        missing = torch.empty(0, 0, CHANNELS[name])
        maps = [material.maps.get(name, missing).detach().cpu().double() for material in materials.parts]
        texels = torch.cat([values.reshape(-1, CHANNELS[name]) for values in maps])
        return cls(texels.numpy(), tuple(values.shape for values in maps), repeat)

    def taps(self, part: Int[ndarray, " points"], uv: Float[ndarray, "points 2"]) -> Taps:
        """The lookup at each point. The points' parts must have the map."""
        rows, cols = np.array([shape[:-1] or (1, 1) for shape in self.shapes]).T
        first = np.cumsum(rows * cols) - rows * cols
        taps = bilinear_taps(uv, rows[part], cols[part], self.repeat)
        return Taps(first[part, None] + taps.index, taps.weight)

    def lookup(self, part: Int[ndarray, " points"], uv: Float[ndarray, "points 2"]) -> Lookup:
        """The lookup at those points whose parts have the map."""
        has = np.array([shape.numel() > 0 for shape in self.shapes])
        points = np.flatnonzero(has[part])
        return Lookup(points, self.taps(part[points], uv[points]))

    def split(self, gradient: Float[ndarray, "texels channels"]) -> list[Float[Tensor, "*shape"]]:
        """The gradient of each part's map, float32 and shaped like that map."""
        sizes = [shape.numel() // shape[-1] for shape in self.shapes]
        pieces = torch.from_numpy(gradient).float().split(sizes)
        return [piece.reshape(shape) for piece, shape in zip(pieces, self.shapes, strict=True)]


def bilinear_taps(
    uv: Float[ndarray, "points 2"],
    rows: int | Int[ndarray, " points"],
    cols: int | Int[ndarray, " points"],
    repeat: tuple[bool, bool],
) -> Taps:
    """The four texels around each point, with weights that sum to 1.

    Texel (row, col) is centred at u = (col + 0.5) / cols, v = (row + 0.5) / rows.

    Args:
        repeat: whether to repeat along u and along v, instead of clamping.
    """
    left, right, x = _neighbours(uv[:, 0], cols, repeat[0])
    lower, upper, y = _neighbours(uv[:, 1], rows, repeat[1])
    index = [lower * cols + left, lower * cols + right, upper * cols + left, upper * cols + right]
    weight = [(1 - y) * (1 - x), (1 - y) * x, y * (1 - x), y * x]
    return Taps(np.stack(index, axis=-1), np.stack(weight, axis=-1))


def _neighbours(
    coordinate: Float[ndarray, " points"], size: int | Int[ndarray, " points"], repeat: bool
) -> tuple[Int[ndarray, " points"], Int[ndarray, " points"], Float[ndarray, " points"]]:
    """The texels before and after along one axis, and the weight of the latter."""
    position = coordinate * size - 0.5
    floor = np.floor(position)
    before = floor.astype(np.int64)
    pair = np.stack([before, before + 1])
    before, after = pair % size if repeat else np.clip(pair, 0, np.asarray(size) - 1)
    return before, after, position - floor
