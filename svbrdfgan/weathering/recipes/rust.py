"""Rust: corrosion of painted steel."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar

import torch

from svbrdfgan.weathering.ranges import number
from svbrdfgan.weathering.recipes.recipe import Coat, Colors, Options, Values
from svbrdfgan.weathering.recipes.shaping import Ground, blend, film, mix, over, ramp
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.substances import Substance, by_substance

_ORANGE = (0.385, 0.150, 0.038)
_BROWN = (0.181, 0.057, 0.017)
_DARK = (0.062, 0.024, 0.013)
_STAIN = (0.330, 0.145, 0.050)
_STREAK = (0.230, 0.085, 0.024)
_PRIMER = (0.240, 0.225, 0.205)


@dataclass(frozen=True)
class Rust(Options):
    """Corrosion that starts at edges, sills and recesses, spreads in blotches with a ring of blistered paint, and runs
    down from them.

    Attributes:
        amount: 0 is intact metal, 1 is heavily rusted.
        bleed: strength of the runs below the blotches.

    Raises:
        ConfigError: an option out of its range.
    """

    bleed: float = number(1.0, 0.0, 2.0)

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType({Substance.PAINT: 1.0, Substance.STEEL: 1.0})
    """What rusts."""
    reads_edges: ClassVar[bool] = True

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`."""
        ground = Ground(self, site)
        blotches = self._blotched(ground)
        flakes, pits = ground.noise(0.055, 2), ground.noise(0.012, 3)
        can = by_substance(site.substance, self.settles_on)
        threshold = 1.78 - 1.15 * self.amount
        present = min(1.0, 6.0 * self.amount) * can
        prone = _prone(ground)
        depth = prone + blotches + 0.20 * flakes + 0.07 * pits - threshold
        core = ramp(0.0, 0.10, depth)
        specks, speckled = _specks(ground, depth, flakes)
        halo, runs = self._stain(ground, prone, depth, threshold)
        stain = over(halo, runs)
        bare = ramp(-0.16, -0.10, depth) * ramp(0.02, -0.02, depth) * ramp(0.10, 0.30, flakes + 0.4 * pits)
        body = _body(depth, blotches, flakes, pits)
        eaten = over(core, specks)
        alpha = over(eaten, over(0.9 * bare, stain))
        color = blend(
            mix(_STAIN, _STREAK, runs), stain, mix(_PRIMER, _STAIN, 0.35 + 0.3 * torch.tanh(flakes)), 0.9 * bare
        )
        color = blend(color, over(0.9 * bare, stain), mix(body, _BROWN, 0.4 * speckled * (1.0 - core)), eaten)
        blister = ramp(-0.22, -0.04, depth) * ramp(0.12, 0.0, depth) * (0.5 + 0.5 * torch.tanh(2.0 * flakes + pits))
        height = 0.0011 * blister + 0.0008 * core * (0.35 + 0.6 * flakes + 0.5 * pits) + 0.0003 * specks
        return Coat(
            color=color,
            alpha=present * alpha,
            roughness=(0.82 + 0.06 * blotches + 0.10 * pits - 0.10 * bare + 0.04 * flakes).clamp(0.5, 1.0),
            metallic=torch.zeros_like(alpha),
            height=present * height / site.length,
        )

    def _stain(self, ground: Ground, prone: Values, depth: Values, threshold: float) -> tuple[Values, Values]:
        """Alpha of a halo around the rust, and of runs from where there is rust at their heads."""
        halo = 0.5 * film(2.2 * ramp(-0.50, 0.05, depth))
        strength = torch.zeros_like(depth)
        for width, length, stream in ((0.060, 0.60, 10), (0.022, 0.30, 16)):
            for run in ground.runs(width, length, torch.ones_like(depth), stream):
                source = prone + self._blotched(ground, run.head) - threshold
                strength = torch.maximum(
                    strength, run.strength * ramp(-0.45, 0.05, source) * (0.4 + 0.6 * run.random[:, 1])
                )
        return halo, 0.85 * film(1.9 * self.bleed * strength)

    def _blotched(self, ground: Ground, moved: Colors | None = None) -> Values:
        """The coarse part of where rust is, which also feeds the runs."""
        broad = ground.noise(0.9, 0, finest=0.1, moved=moved)
        return 0.50 * broad + 0.42 * ground.noise(0.30, 1, finest=0.03, moved=moved)


def _prone(ground: Ground) -> Values:
    """Where rust begins: at edges whose paint is worn, in creases that stay wet, low down, behind wheels."""
    edge = 0.50 * torch.exp(-ground.convex / 0.018) + 0.30 * torch.exp(-ground.border / 0.025)
    crease = 0.42 * torch.exp(-ground.crease / 0.03) + 0.25 * ramp(0.1, 0.8, -ground.curvature)
    low = 0.55 * ramp(0.75, 0.15, ground.up)
    damp = 0.35 * ramp(0.85, 0.3, ground.visibility)
    arches = torch.zeros_like(ground.up)
    for axle in ground.site.axles:
        away = torch.hypot(ground.place[:, 2] - axle * ground.site.length, ground.up - 0.33)
        arches = torch.maximum(arches, 0.40 * ramp(0.62, 0.40, away))
    return edge + crease + low + damp + arches + 0.12 * ramp(0.1, 0.7, ground.curvature)


def _specks(ground: Ground, depth: Values, flakes: Values) -> tuple[Values, Values]:
    """Single points of rust, denser near blotches: their alpha, and how far each is inside."""
    alpha = inside = torch.zeros_like(depth)
    for cell, most, stream in ((0.060, 0.55, 20), (0.022, 0.5, 22)):
        ragged = 0.16 * cell * torch.stack([flakes, ground.noise(0.4 * cell, stream + 1), -flakes], dim=1)
        share = most * ramp(-0.95, 0.0, depth) ** 2
        found = ground.spots(cell, share, stream, warp=ragged)
        alpha = over(ramp(0.30, 0.62, found.inside), over(0.5 * ramp(0.0, 0.5, found.inside), alpha))
        inside = torch.maximum(inside, found.inside)
    return alpha, inside


def _body(depth: Values, blotches: Values, flakes: Values, pits: Values) -> Colors:
    """Rust's own colour: bright where it is young or has been rubbed, dark where it is deep; mottled at all scales."""
    old = ramp(-0.15, 0.75, 0.8 * depth + 0.50 * blotches + 0.34 * flakes + 0.22 * pits)
    warm = mix(_ORANGE, _BROWN, ramp(-0.55, 0.35, depth + 0.5 * flakes + 0.35 * pits - 0.1))
    return mix(warm, _DARK, 0.92 * old)
