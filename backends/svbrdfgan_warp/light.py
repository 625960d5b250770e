"""An environment on the device, with the tables from which directions are drawn in proportion to its light."""

from __future__ import annotations

import math
import weakref
from dataclasses import dataclass, field
from itertools import accumulate, islice
from typing import Any

import torch
import torch.nn.functional as F
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.rendering.validation import check_radiance
from svbrdfgan.types import Environment
from svbrdfgan_warp.emitter import Light

_NUMBERS = 2**32
_KEPT, _PIXELS = 12, 2**24
"""Environments kept, and their pixels, at most; a pixel takes 32 bytes."""


@dataclass(frozen=True, eq=False)
class _Kept:
    """A light, a copy of its radiance, and what that was last copied from or found equal to."""

    radiance: Float[Tensor, "rows cols 3"]
    light: Light
    source: weakref.ref[Tensor]


@dataclass(frozen=True, eq=False)
class Lights:
    """Environments on one device: the last few are kept, and known again by what they hold.

    Attributes:
        kept: those used last in front.
    """

    device: torch.device
    kept: list[_Kept] = field(default_factory=list)

    def of(self, environment: Environment) -> Light:
        """The environment as the kernels read it.

        Raises:
            AssetError: radiance that is negative or not finite.
        """
        given, before = environment.radiance, tuple(self.kept)
        radiance = given.detach().to(self.device, torch.float32)
        # The same tensor first; compared nevertheless, since not every way to write into one is seen by torch.
        likely = sorted(before, key=lambda kept: kept.source() is not given)
        same = next((kept for kept in likely if torch.equal(kept.radiance, radiance)), None)
        values = (same.radiance, same.light) if same else (radiance.clone(), _tables(radiance))
        first = _Kept(*values, weakref.ref(given))
        # A list is replaced in one step, so that threads see an old one or a new one.
        self.kept[:] = _fitting([first, *(kept for kept in before if kept is not same)])
        return _turned(first.light, environment.rotation)


def _fitting(lights: list[_Kept]) -> list[_Kept]:
    """The first, and as many after it as may be kept."""
    pixels = accumulate(kept.radiance.numel() // 3 for kept in lights)
    return lights[: max(1, sum(total <= _PIXELS for total in islice(pixels, _KEPT)))]


def _turned(light: Light, rotation: float) -> Light:
    turned: Any = Light()
    turned.texels, turned.row_first, turned.col_first = light.texels, light.row_first, light.col_first
    turned.rotation = rotation
    return turned


def _tables(radiance: Float[Tensor, "rows cols 3"]) -> Light:
    """What the kernels read, but for the rotation."""
    check_radiance(radiance)
    rows, cols, _ = radiance.shape
    importance = _importance(radiance)
    row_share, row_first = _table(importance.sum(dim=1, keepdim=True).T)
    col_share, col_first = _table(importance)
    density = row_share.T * col_share * (rows * cols / (2 * math.pi**2))

    light: Any = Light()
    light.texels = wp.from_torch(torch.cat([radiance, density.float()[..., None]], dim=2), dtype=wp.vec4)
    light.row_first = wp.from_torch(row_first, dtype=wp.uint32)
    light.col_first = wp.from_torch(col_first, dtype=wp.uint32)
    return light


def _importance(radiance: Float[Tensor, "rows cols 3"]) -> Float[Tensor, "rows cols"]:
    """Light per pixel times its solid angle, spread over 3x3 pixels because bilinear lookup spreads light likewise.

    A black environment counts as an even one.
    """
    rows = radiance.shape[0]
    grey = radiance.mean(dim=2)[None, None]
    grey = torch.where(grey.any(), grey, 1.0)
    padded = F.pad(F.pad(grey, (1, 1, 0, 0), mode="circular"), (0, 0, 1, 1), mode="replicate")
    polar = (torch.arange(rows, dtype=torch.float32, device=radiance.device) + 0.5) * (math.pi / rows)
    return (F.avg_pool2d(padded, 3, stride=1)[0, 0] * polar.sin()[:, None]).double()


def _table(weight: Float[Tensor, "rows cols"]) -> tuple[Float[Tensor, "rows cols"], Int[Tensor, "rows cols"]]:
    """The probability of each column in its row, and the first of the 2^32 numbers that draw it, as uint32 bits.

    Probabilities are whole numbers of 2^-32, so that the density used is exactly the one drawn from, and sums do not
    depend on their order. What is rounded off goes to the last column; in a row without weight, that is all.
    """
    share = (weight / weight.sum(dim=1, keepdim=True).clamp_min(1e-300) * (_NUMBERS - 1)).long()
    first = F.pad(share[:, :-1].cumsum(dim=1), (1, 0))
    share[:, -1] = _NUMBERS - first[:, -1]
    return share.double() / _NUMBERS, first.int()
