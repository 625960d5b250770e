"""What lies under a layer, which decides what can settle on it or eat it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from functools import lru_cache

import torch
from jaxtyping import Float, Int
from torch import Tensor


class Substance(IntEnum):
    """What a surface is made of, as far as weathering cares; the numbers are stored nowhere."""

    PAINT = 0
    """Painted sheet steel, and whatever is not known."""
    STEEL = 1
    """Bare or primed: frames, axles, exhausts."""
    ALLOY = 2
    """Light or plated metal, which does not rust: rims, chrome."""
    PLASTIC = 3
    """Trim, bumpers, plates, decals."""
    GLASS = 4
    """Windows, mirrors and lamps."""
    RUBBER = 5
    """Tyres and seals."""


def by_substance(substance: Int[Tensor, " texels"], shares: Mapping[Substance, float]) -> Float[Tensor, " texels"]:
    """The number of each texel's substance, float32; 0 for those that are not named."""
    return _table(tuple(shares.get(kind, 0.0) for kind in Substance), substance.device)[substance.long()]


@lru_cache(maxsize=64)
def _table(shares: tuple[float, ...], device: torch.device) -> Float[Tensor, " substances"]:
    return torch.tensor(shares, device=device)
