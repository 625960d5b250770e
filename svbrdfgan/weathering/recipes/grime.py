"""Grime: greasy dark dirt of years, in recesses, gaps and below them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import torch

from svbrdfgan.weathering.ranges import number
from svbrdfgan.weathering.recipes.recipe import Coat, Options, Values
from svbrdfgan.weathering.recipes.shaping import Ground, film, mix, ramp
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.substances import Substance, by_substance

_SOOT = (0.028, 0.024, 0.020)
_GREASE = (0.085, 0.068, 0.050)


@dataclass(frozen=True)
class Grime(Options):
    """Dark dirt that stays in creases, gaps and recesses when a vehicle is wiped, and streaks down from them.

    Attributes:
        amount: 0 is clean, 1 is neglected for years.
        streaks: strength of the streaks.

    Raises:
        ConfigError: an option out of its range.
    """

    streaks: float = number(1.0, 0.0, 1.0)

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType(
        {
            Substance.PAINT: 1.0,
            Substance.STEEL: 1.0,
            Substance.ALLOY: 0.8,
            Substance.PLASTIC: 0.8,
            Substance.GLASS: 0.4,
            Substance.RUBBER: 0.6,
        }
    )
    """Thickness on each substance."""
    reads_edges: ClassVar[bool] = True

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`."""
        ground = Ground(self, site)
        broad, patches, grain = ground.noise(0.9, 0), ground.noise(0.12, 1), ground.noise(0.015, 2)
        spread = (1.0 + 0.5 * patches).clamp(min=0.2)
        gaps = 0.9 * torch.exp(-ground.border / (0.012 * spread)) + 1.1 * torch.exp(-ground.crease / (0.022 * spread))
        recesses = 1.6 * ramp(0.80, 0.25, ground.visibility) + 0.7 * ramp(0.08, 0.7, -ground.curvature)
        thin = 0.10 + 0.08 * ramp(0.5, -0.4, ground.normal[:, 1]) + 0.16 * ramp(0.7, 0.1, ground.up)
        depth = (gaps + recesses + thin) * (1.0 + 0.30 * broad + 0.34 * patches + 0.14 * grain).clamp(min=0.08)
        depth = depth + 0.55 * self.streaks * self._streaked(ground, broad) * (1.0 + 0.4 * grain).clamp(min=0.0)
        gain = 1.9 * self.amount**1.2 * by_substance(site.substance, self.settles_on)
        alpha = film(gain * depth)
        return Coat(
            color=mix(_GREASE, _SOOT, ramp(-0.7, 1.1, 0.5 * patches + 0.4 * grain + depth - 0.8)),
            alpha=0.95 * alpha,
            roughness=(0.72 + 0.10 * patches + 0.06 * grain).clamp(0.4, 0.95),
            metallic=torch.zeros_like(alpha),
            height=0.00015 * alpha * (1.0 + grain) / site.length,
        )

    def _streaked(self, ground: Ground, broad: Values) -> Values:
        """Streaks that rain drew down steep surfaces."""
        strength = torch.zeros_like(ground.up)
        for width, length, stream in ((0.06, 0.9, 10), (0.024, 0.45, 14)):
            for run in ground.runs(width, length, 0.6 * ramp(-0.4, 0.8, broad), stream):
                strength = torch.maximum(strength, run.strength * (0.3 + 0.7 * run.random[:, 1]))
        return strength
