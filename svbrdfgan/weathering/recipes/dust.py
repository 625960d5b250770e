"""Dust: what settles from the air on whatever faces up."""

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

_BEIGE = (0.375, 0.325, 0.255)
_GREY = (0.300, 0.275, 0.240)


@dataclass(frozen=True)
class Dust(Options):
    """Dust on what faces up and in sheltered corners, with the marks of drops that fell into it and dried.

    Attributes:
        amount: 0 is clean, 1 is dusty all over.
        drops: strength of the marks of rain.

    Raises:
        ConfigError: an option out of its range.
    """

    drops: float = number(0.6, 0.0, 1.0)

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType(
        {
            Substance.PAINT: 1.0,
            Substance.STEEL: 1.0,
            Substance.ALLOY: 0.8,
            Substance.PLASTIC: 1.0,
            Substance.GLASS: 0.6,
            Substance.RUBBER: 1.0,
        }
    )
    """Thickness on each substance."""

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`."""
        ground = Ground(self, site)
        broad, drifts = ground.noise(1.4, 0), ground.noise(0.30, 1, stretch=(1.0, 1.0, 1.6))
        grain, fibres = ground.noise(0.006, 2), ground.noise(0.05, 3, stretch=(3.0, 1.0, 1.0))
        facing = 0.10 + 0.90 * ramp(-0.15, 0.95, ground.normal[:, 1])
        sheltered = 0.55 * ramp(0.75, 0.25, ground.visibility) * ramp(-0.6, 0.2, ground.normal[:, 1])
        hollows = 0.45 * ramp(0.05, 0.6, -ground.curvature)
        depth = facing + sheltered + hollows * facing
        depth = depth * (1.0 + 0.28 * broad + 0.20 * drifts + 0.10 * fibres + 0.16 * grain).clamp(min=0.1)
        gain = 1.5 * self.amount**1.2 * by_substance(site.substance, self.settles_on)
        depth = gain * depth * self._rained(ground, drifts) * self._washed(ground, broad)
        alpha = film(depth)
        tint = ramp(-1.0, 1.0, 0.7 * broad + 0.4 * drifts + 0.35 * grain)
        return Coat(
            color=mix(_GREY, _BEIGE, tint),
            alpha=0.94 * alpha,
            roughness=(0.93 + 0.04 * broad + 0.03 * grain).clamp(0.8, 1.0),
            metallic=torch.zeros_like(alpha),
            height=0.00012 * alpha * (1.0 + grain) / site.length,
        )

    def _rained(self, ground: Ground, drifts: Values) -> Values:
        """Drops that dried: a clean middle within a rim of what they carried outwards."""
        left = torch.ones_like(ground.up)
        level = ramp(0.2, 0.8, ground.normal[:, 1])
        for cell, stream in ((0.10, 20), (0.045, 22)):
            ragged = 0.06 * cell * torch.stack([drifts, ground.noise(0.5 * cell, stream + 1), -drifts], dim=1)
            share = 0.5 * level * ramp(-0.6, 0.8, drifts)
            found = ground.spots(cell, share, stream, warp=ragged)
            middle, rim = ramp(0.16, 0.34, found.inside), ramp(0.0, 0.10, found.inside) * ramp(0.30, 0.14, found.inside)
            left = left * (1.0 + self.drops * (0.45 * rim - 0.5 * middle * (0.4 + 0.6 * found.random[:, 2])))
        return left

    def _washed(self, ground: Ground, broad: Values) -> Values:
        """What runs of rain leave on steep surfaces."""
        left = torch.ones_like(broad)
        for run in ground.runs(0.035, 0.5, 0.6 * ramp(-0.6, 0.6, broad), 10):
            left = left * (1.0 - 0.6 * self.drops * run.strength)
        return left
