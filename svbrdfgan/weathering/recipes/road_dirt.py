"""Road dirt: a film of dried spray, droplets and mud."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import torch

from svbrdfgan.weathering.ranges import number
from svbrdfgan.weathering.recipes.recipe import Coat, Options, Values
from svbrdfgan.weathering.recipes.shaping import Ground, blend, film, mix, over, ramp
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.substances import Substance, by_substance

_CAR = 1.4  # metres: height to which the default reach applies
_FILM = (0.265, 0.212, 0.155)
_PALE = (0.345, 0.290, 0.225)
_MUD = (0.128, 0.090, 0.060)
_CLAY = (0.205, 0.150, 0.102)


@dataclass(frozen=True)
class RoadDirt(Options):
    """Road film that thins upwards, droplets thrown up behind the wheels, mud low down; runs of water thin them.

    Attributes:
        amount: 0 is clean, 1 is filthy.
        reach: height up to which the dirt reaches, relative to the default.
        spray: strength of the dirt behind the wheels.
        runs: strength of the traces of water.

    Raises:
        ConfigError: an option out of its range.
    """

    reach: float = number(1.0, 0.1, 3.0)
    spray: float = number(1.0, 0.0, 2.0)
    runs: float = number(1.0, 0.0, 1.0)

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType(
        {
            Substance.PAINT: 1.0,
            Substance.STEEL: 1.0,
            Substance.ALLOY: 0.9,
            Substance.PLASTIC: 1.0,
            Substance.GLASS: 0.45,
            Substance.RUBBER: 0.45,
        }
    )
    """Thickness on each substance."""

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`."""
        ground = Ground(self, site)
        reach = self.reach * (site.tall / _CAR) ** 0.7
        broad, patches = ground.noise(1.1, 0), ground.noise(0.28, 1)
        grain = ground.noise(0.035, 2)
        gain = 5.4 * self.amount**1.3 * by_substance(site.substance, self.settles_on)
        thrown = self.spray * _thrown(ground, broad, reach)
        low = torch.exp(-ground.up.clamp(min=0.0) / (0.32 * reach * (1.0 + 0.35 * broad).clamp(min=0.4)))
        wake = 0.30 * ramp(0.25, 0.95, -ground.normal[:, 2]) * ramp(1.9, 0.3, ground.up / reach)
        sheltered = 0.22 * (1.0 - ground.visibility).clamp(0.0, 1.0) * ramp(1.6, 0.4, ground.up)
        lying = 0.045 + 0.06 * ramp(0.5, 0.95, ground.normal[:, 1])
        depth = lying + 1.15 * low + wake + sheltered + 1.1 * thrown
        depth = depth * (1.0 + 0.35 * patches + 0.22 * grain).clamp(min=0.15)
        depth = gain * depth * self._washed(ground, broad)
        wet = gain * (0.8 * thrown + 0.45 * low + 0.04)
        drops, lumps = _drops(ground, wet, patches)
        mud, cake = _mud(ground, gain * (0.75 * low + 0.65 * thrown), patches, grain)
        alpha = over(mud, over(drops, film(depth)))
        tint = ramp(-0.9, 0.9, 0.8 * broad + 0.5 * patches + 0.3 * grain)
        thick = mix(_MUD, _CLAY, ramp(-0.5, 0.9, grain + 0.6 * patches - 0.6 * cake))
        color = blend(mix(_FILM, _PALE, tint), film(depth), mix(_FILM, _CLAY, 0.65 - 0.4 * tint), drops)
        color = blend(color, over(drops, film(depth)), thick, mud)
        height = 0.00025 * lumps + mud * (0.0012 + 0.0010 * grain)
        return Coat(
            color=color,
            alpha=0.97 * alpha,
            roughness=(0.90 + 0.08 * grain - 0.10 * mud * ramp(0.0, 0.8, patches)).clamp(0.5, 1.0),
            metallic=torch.zeros_like(alpha),
            height=height / site.length,
        )

    def _washed(self, ground: Ground, broad: Values) -> Values:
        """What runs of water leave of the film."""
        left = torch.ones_like(ground.up)
        for width, length, stream in ((0.06, 0.80, 10), (0.024, 0.36, 14)):
            for run in ground.runs(width, length, 0.6 * ramp(-0.5, 0.7, broad), stream):
                left = left * (1.0 - 0.55 * self.runs * run.strength)
        return left


def _thrown(ground: Ground, broad: Values, reach: float) -> Values:
    """What wheels throw up behind them, in [0, 1]: from the axle backwards, rising and fading."""
    thrown = torch.zeros_like(ground.up)
    for axle in ground.site.axles:
        behind = axle * ground.site.length - ground.place[:, 2]
        along = ramp(-0.25, 0.30, behind) * torch.exp(-behind.clamp(min=0.0) / 0.62)
        top = reach * (0.30 + 0.34 * behind.clamp(0.0, 1.2) + 0.16 * broad).clamp(min=0.1)
        thrown = torch.maximum(thrown, along * torch.exp(-((ground.up / top.clamp(min=0.1)) ** 2)))
    return thrown


def _drops(ground: Ground, wet: Values, patches: Values) -> tuple[Values, Values]:
    """Dried droplets of several sizes: their alpha, and their height from 0 to 1."""
    alpha = lumps = torch.zeros_like(wet)
    for cell, most, stream in (
        (0.060, 0.10, 20),
        (0.026, 0.6, 22),
        (0.012, 1.0, 24),
        (0.012, 1.0, 26),
        (0.007, 1.0, 28),
    ):
        ragged = 0.10 * cell * torch.stack([patches, ground.noise(0.6 * cell, stream + 1), -patches], dim=1)
        share = most * (1.0 - torch.exp(-0.9 * wet * (1.0 + 0.7 * patches).clamp(min=0.0)))
        found = ground.spots(cell, share, stream, warp=ragged, flow=1.4)
        strength = 0.30 + 0.6 * found.random[:, 2]
        alpha = over(strength * ramp(0.0, 0.45, found.inside), alpha)
        lumps = torch.maximum(lumps, cell / 0.03 * ramp(0.0, 0.9, found.inside))
    return alpha, lumps


def _mud(ground: Ground, wet: Values, patches: Values, grain: Values) -> tuple[Values, Values]:
    """Caked mud where most is thrown: its alpha, with broken edges, and how thick it is."""
    depth = wet + 0.50 * patches + 0.30 * grain - 1.9
    return 0.9 * ramp(-0.05, 0.55, depth), ramp(0.1, 1.2, depth)
