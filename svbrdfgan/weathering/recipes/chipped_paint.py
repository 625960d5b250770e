"""Chipped paint: stone chips, worn edges and scratches, down to primer and steel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import torch

from svbrdfgan.weathering.ranges import number
from svbrdfgan.weathering.recipes.recipe import Coat, Options, Values
from svbrdfgan.weathering.recipes.shaping import Ground, blend, mix, over, ramp
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.substances import Substance, by_substance

_PRIMER = (0.300, 0.290, 0.275)
_STEEL = (0.560, 0.545, 0.520)
_TARNISHED = (0.300, 0.275, 0.250)
_RUST = (0.215, 0.080, 0.026)
_OLD_RUST = (0.095, 0.036, 0.016)
_SCUFF = (0.520, 0.510, 0.495)


@dataclass(frozen=True)
class ChippedPaint(Options):
    """Paint chipped off edges and where stones hit, with a rim of primer around the steel, and scratches.

    Attributes:
        amount: 0 is intact paint, 1 is heavily chipped.
        scratches: strength of the scratches.
        rust: how much of the bare steel has begun to rust.

    Raises:
        ConfigError: an option out of its range.
    """

    scratches: float = number(1.0, 0.0, 2.0)
    rust: float = number(0.5, 0.0, 1.0)

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType({Substance.PAINT: 1.0})
    """What has paint to lose."""
    metal: ClassVar[bool] = True
    reads_edges: ClassVar[bool] = True

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`."""
        ground = Ground(self, site)
        patches, ragged, grain = ground.noise(0.5, 0), ground.noise(0.05, 1), ground.noise(0.012, 2)
        can = by_substance(site.substance, self.settles_on) * min(1.0, 8.0 * self.amount)
        depth = torch.maximum(self._worn(ground, patches, ragged, grain), self._hit(ground, patches, ragged, grain))
        chipped, bare = ramp(0.0, 0.05, depth), ramp(0.10, 0.17, depth)
        scuffed, cut = self._scratched(ground, patches)
        cut = cut * (1.0 - chipped)
        rusty = self.rust * ramp(-0.35, 0.65, patches + 0.8 * ragged + 0.5 * grain - 0.1)
        steel = mix(_STEEL, _TARNISHED, ramp(-0.6, 0.8, ragged + grain))
        rust = mix(_RUST, _OLD_RUST, ramp(-0.6, 0.6, grain + 0.5 * ragged))
        primer = mix(_PRIMER, _TARNISHED, 0.35 * ramp(-0.5, 0.8, grain))
        inner = mix(primer, mix(steel, rust, rusty), bare)
        alpha = over(over(cut, chipped), scuffed)
        color = blend(_SCUFF, scuffed, mix(inner, mix(_STEEL, _RUST, 0.6 * rusty), cut), over(cut, chipped))
        metal = torch.maximum(bare * chipped, cut) * (1.0 - rusty)
        rough = 0.62 - 0.24 * metal + 0.25 * rusty * bare + 0.06 * grain
        return Coat(
            color=color,
            alpha=can * alpha,
            roughness=rough.clamp(0.2, 1.0),
            metallic=metal.clamp(0.0, 1.0),
            height=-can
            * (0.00022 * chipped + 0.00010 * bare + 0.0001 * cut - 0.0002 * bare * rusty * grain)
            / site.length,
        )

    def _worn(self, ground: Ground, patches: Values, ragged: Values, grain: Values) -> Values:
        """Depth below the paint along edges, and where whole flakes have come off."""
        width = 0.006 + 0.024 * self.amount
        edge = torch.exp(-torch.minimum(ground.convex, ground.border * 1.5) / width)
        sills = 0.30 * ramp(0.55, 0.15, ground.up)
        exposed = 1.05 * edge + sills + 0.20 * ramp(0.15, 0.8, ground.curvature)
        return exposed + 0.28 * patches + 0.26 * ragged + 0.08 * grain - (1.75 - 1.15 * self.amount)

    def _hit(self, ground: Ground, patches: Values, ragged: Values, grain: Values) -> Values:
        """Depth below the paint where stones hit: in front, on sills and behind wheels."""
        front = ramp(0.15, 0.9, ground.normal[:, 2]) * ramp(1.3, 0.5, ground.up)
        behind = torch.zeros_like(front)
        for axle in ground.site.axles:
            away = axle * ground.site.length - ground.place[:, 2]
            behind = torch.maximum(behind, ramp(0.1, 0.35, away) * ramp(1.1, 0.35, away) * ramp(0.85, 0.3, ground.up))
        where = 0.12 + 0.9 * front + 0.85 * behind + 0.3 * ramp(0.5, 0.2, ground.up)
        depth = torch.full_like(front, -1.0)
        for cell, most, stream in ((0.11, 0.35, 20), (0.06, 0.9, 22), (0.026, 1.0, 24), (0.026, 1.0, 26)):
            outline = 0.18 * cell * torch.stack([ragged, ground.noise(0.35 * cell, stream + 1), -ragged], dim=1)
            share = most * self.amount * where * (1.0 + 0.7 * patches).clamp(0.0, 2.0)
            found = ground.spots(cell, share.clamp(0.0, 1.0), stream, warp=outline)
            size = cell * (0.15 + 0.35 * found.random[:, 1]) / 0.05
            depth = torch.maximum(depth, found.inside * size - 0.55 * size * 0.3 + 0.03 * grain * found.inside)
        return depth

    def _scratched(self, ground: Ground, patches: Values) -> tuple[Values, Values]:
        """Coverage of scuffs in the clear coat, and of scratches down to the metal."""
        scuffed = cut = torch.zeros_like(ground.up)
        flank = ground.steep() * ramp(0.2, 0.5, ground.up)
        for cell, width, stream in ((0.9, 0.0018, 30), (0.35, 0.0012, 32), (0.35, 0.0009, 33), (0.12, 0.0007, 34)):
            share = self.amount * min(1.0, 0.7 * self.scratches) * ramp(-0.9, 0.3, patches) * (0.5 + 0.5 * flank)
            found = ground.scratches(cell, share, stream)
            wide = max(width, 0.7 * ground.texel)
            line = 0.9 * width / wide * ramp(1.0, 0.4, found.across / (wide * found.weight.clamp(min=1e-6)))
            deep = ramp(0.62, 0.75, found.random[:, 2])
            scuffed, cut = over(line * (1.0 - deep), scuffed), over(line * deep, cut)
        return scuffed, cut
