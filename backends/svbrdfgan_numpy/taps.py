"""Bilinear lookups as sparse linear maps, so that the adjoint is the transpose of the very same thing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray


@dataclass(frozen=True, eq=False)
class Taps:
    """For each point, the texels that it reads and how much of each.

    Attributes:
        index: into a flat list of texels.
        weight: of each of them.
    """

    index: Int[ndarray, "points taps"]
    weight: Float[ndarray, "points taps"]

    def apply(self, texels: Float[ndarray, "texels channels"]) -> Float[ndarray, "points channels"]:
        """The weighted sum of its texels at each point."""
        return np.einsum("pt,ptc->pc", self.weight, texels[self.index])

    def at(self, points: Int[ndarray, " chosen"]) -> Taps:
        """The lookups of some of the points."""
        return Taps(self.index[points], self.weight[points])

    def scaled(self, factor: Float[ndarray, " points"]) -> Taps:
        """The same lookups, each point's result multiplied by its factor."""
        return Taps(self.index, self.weight * factor[:, None])

    @staticmethod
    def summed(taps: Sequence[Taps]) -> Taps:
        """The sum of several lookups at the same points."""
        index, weight = [t.index for t in taps], [t.weight for t in taps]
        return Taps(np.concatenate(index, axis=1), np.concatenate(weight, axis=1))

    def transpose(self, values: Float[ndarray, "points channels"], texels: int) -> Float[ndarray, "texels channels"]:
        """What `values` at the points amount to at the texels: the transpose of `apply`."""
        index = self.index.ravel()
        scattered = [np.bincount(index, (self.weight * v[:, None]).ravel(), minlength=texels) for v in values.T]
        return np.stack(scattered, axis=-1, dtype=np.float64)  # NumPy counts nothing in int64


def bilinear_taps(
    uv: Float[ndarray, "points 2"],
    rows: int | Int[ndarray, " points"],
    cols: int | Int[ndarray, " points"],
    repeat: tuple[bool, bool],
) -> Taps:
    """The four texels around each point. Texel (row, col) is centred at u = (col + 0.5) / cols, v = (row + 0.5) / rows.

    Args:
        repeat: whether to repeat along u and along v, instead of clamping. All four weights sum to 1.
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
