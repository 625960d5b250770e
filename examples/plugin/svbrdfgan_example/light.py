"""Light from far away, looked up and sampled; and the texture filter, which is the same but for its borders."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from svbrdfgan.types import Environment


def bilinear(image: Tensor, uv: Tensor, repeat: tuple[bool, bool] = (False, False)) -> Tensor:
    """An image (rows, cols, channels) between its pixels' centres: row 0 at v = 0, clamped where it does not repeat."""
    rows, cols, _ = image.shape
    (left, right, x), (below, above, y) = _taps(uv[:, 0], cols, repeat[0]), _taps(uv[:, 1], rows, repeat[1])
    lower = image[below, left] * (1 - x) + image[below, right] * x
    upper = image[above, left] * (1 - x) + image[above, right] * x
    return lower * (1 - y) + upper * y


def _taps(coordinate: Tensor, size: int, repeat: bool) -> tuple[Tensor, Tensor, Tensor]:
    place = coordinate * size - 0.5
    low = place.floor()
    taps = torch.stack([low, low + 1]).long()
    taps = taps % size if repeat else taps.clamp(0, size - 1)
    return taps[0], taps[1], (place - low)[:, None]


@dataclass(frozen=True, eq=False)
class Light:
    """An environment.

    Attributes:
        radiance: (rows, cols, 3); may require gradients.
        chance: of each pixel to be drawn (rows, cols), in proportion to its light.
        turn: from the environment's directions to the world's, (3, 3).
    """

    radiance: Tensor
    chance: Tensor
    turn: Tensor

    @classmethod
    def of(cls, environment: Environment, radiance: Tensor) -> Light:
        """The environment, with this radiance in place of its own."""
        rows = len(radiance)
        polar = (torch.arange(rows, dtype=torch.float64) + 0.5) / rows * math.pi
        power = (radiance.detach().sum(2).clamp(min=0) + 1e-30) * polar.sin()[:, None]
        c, s = math.cos(environment.rotation), math.sin(environment.rotation)
        turn = torch.tensor([[c, 0, s], [0, 1, 0], [-s, 0, c]], dtype=torch.float64)
        return cls(radiance, power / power.sum(), turn)

    def sample(self, count: int, rng: torch.Generator) -> Tensor:
        """Directions (count, 3), with the density that `density` tells."""
        rows, cols = self.chance.shape
        total = self.chance.ravel().cumsum(0)
        drawn = torch.rand(count, generator=rng, dtype=torch.float64) * total[-1]
        pixel = torch.searchsorted(total, drawn, right=True).clamp(max=rows * cols - 1)
        # a tent around the pixel's centre, folded back at the poles: bilinear interpolation of the chances
        tent = torch.rand(count, 2, 2, generator=rng, dtype=torch.float64).sum(2) - 1
        u = (pixel % cols + 0.5 + tent[:, 0]) / cols
        v = ((pixel // cols + 0.5 + tent[:, 1]) / rows).abs()
        azimuth, polar = (u - 0.5) * 2 * math.pi, torch.where(v > 1, 2 - v, v) * math.pi
        across = polar.sin()
        return torch.stack([across * azimuth.sin(), polar.cos(), -across * azimuth.cos()], dim=1) @ self.turn.T

    def density(self, direction: Tensor) -> Tensor:
        """Of `sample`, per steradian."""
        rows, cols = self.chance.shape
        uv, across = self._place(direction)
        chance = bilinear(self.chance[..., None], uv, (True, False))[:, 0]
        return chance * rows * cols / (2 * math.pi**2 * across.clamp(min=1e-12))

    def arriving(self, direction: Tensor) -> Tensor:
        """Radiance (n, 3) from each direction."""
        return bilinear(self.radiance, self._place(direction)[0], (True, False))

    def _place(self, direction: Tensor) -> tuple[Tensor, Tensor]:
        """Place in the image, and the sine of the polar angle."""
        x, y, z = (direction @ self.turn).unbind(1)
        across = torch.hypot(x, z)
        return torch.stack([0.5 + torch.atan2(x, -z) / (2 * math.pi), torch.atan2(across, y) / math.pi], dim=1), across
