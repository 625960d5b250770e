"""Smooth recipes, for laboratories: layers that a network can reproduce, and whose sharpness is an option.

A recipe first computes a potential, which is greatest where its matter settles first. Matter shows where the potential
exceeds a threshold that falls as `amount` grows, so coverage never decreases with `amount`.

`detail` adds what a texture of this resolution can show: noise down to four texels, edges a texel or two wide, pits and
bare metal. With detail 0 the finest wavelength at scale 1 is a twentieth of the vehicle's length (several texels at
128 x 128) and has a small amplitude, so that a network that sees position and normal can reproduce it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.weathering.noise import fbm
from svbrdfgan.weathering.ranges import number
from svbrdfgan.weathering.recipes.recipe import Coat, Directions, Options
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.substances import Substance

Values = Float[ndarray, " texels"]


@dataclass(frozen=True, eq=False)
class _Texels:
    """What smooth recipes go by, of a `Site`, in NumPy."""

    position: Float[ndarray, "texels 3"]
    height: Values
    normal: Float[ndarray, "texels 3"]
    visibility: Values
    curvature: Values
    axles: tuple[float, ...]
    texel: float

    @classmethod
    def of(cls, site: Site) -> _Texels:
        tensors = (site.position, site.height, site.normal, site.visibility, site.curvature)
        position, height, normal, visibility, curvature = (each.double().cpu().numpy() for each in tensors)
        return cls(position, height, normal, visibility, curvature, site.axles, site.texel)


@dataclass(frozen=True, eq=False)
class _Painted:
    """A `Coat`, in NumPy."""

    color: Float[ndarray, "texels 3"]
    alpha: Values
    roughness: Values
    metallic: Values
    height: Values


@dataclass(frozen=True)
class _Smooth(Options):
    """The options of smooth recipes, and how they paint.

    Attributes:
        amount, seed, scale, relief: as of every recipe; `scale` is relative to the vehicle.
        detail: 0 is smooth, 1 is as sharp as the texture allows.

    Raises:
        ConfigError: an option out of its range.
    """

    settles_on: ClassVar[Mapping[Substance, float]] = MappingProxyType({})

    amount: float = number(0.8, 0.0, 1.0)
    detail: float = number(0.0, 0.0, 1.0)

    def paint(self, site: Site) -> Coat:
        """All maps; see `Recipe.paint`. The coat is where the site is, in float64."""
        painted = self._painted(_Texels.of(site))
        return Coat(*(torch.from_numpy(np.asarray(values)).to(site.height.device) for values in vars(painted).values()))

    def paint_relief(self, site: Site, *axes: Directions) -> tuple[Coat, list[Float[Tensor, " texels"]]]:
        """All maps and slopes, by differences over a texel; see `Recipe.paint_relief`."""
        texels, step, coat = _Texels.of(site), max(site.texel, 1e-4), self.paint(site)
        height = coat.height.cpu().numpy()
        places = (texels.position + step * axis.double().cpu().numpy() for axis in axes)
        slopes = ((self._painted(replace(texels, position=place)).height - height) / step for place in places)
        return coat, [torch.from_numpy(slope).to(site.height.device) for slope in slopes]

    def _painted(self, site: _Texels) -> _Painted:
        raise NotImplementedError


@dataclass(frozen=True)
class SmoothDirt(_Smooth):
    """Mud and road film: strongest on the sills, behind the wheels, along the flanks and on the tail.

    Attributes:
        amount: 0 is clean, 1 is filthy.
        reach: height up to which the dirt reaches, in heights of the vehicle.
        spray: strength of the dirt behind the wheels.

    Raises:
        ConfigError: an option out of its range.
    """

    reach: float = number(0.65, 0.1, 1.5)
    spray: float = number(1.0, 0.0, 2.0)

    def _painted(self, site: _Texels) -> _Painted:
        patches = _noise(self, site, (5.0, 5.0, 5.0), 0, octaves=3)
        runs = _noise(self, site, (10.0, 1.8, 10.0), 1)
        swept = _noise(self, site, (6.0, 10.0, 2.5), 2)
        height = site.height + 0.20 * patches + 0.12 * runs
        low = _ramp(1.3 * self.reach, -0.1, height)
        thrown = self.spray * _spray(site, height) * (0.9 + 1.2 * swept)
        wake = 0.40 * _ramp(0.3, 1.0, -site.normal[:, 2]) * _ramp(1.1, 0.2, height)
        sheltered = 0.25 * (1.0 - site.visibility) * _ramp(0.9, 0.3, site.height)
        lying = 1.0 - 0.55 * _ramp(0.5, 0.95, site.normal[:, 1]) * _ramp(0.1, 0.4, site.height)
        splashes = _fine(self, site, 24.0, 3)
        potential = lying * (0.85 * low + 1.00 * thrown + wake + sheltered) + 0.65 * patches + 0.30 * runs
        potential = potential + 0.75 * splashes
        alpha, depth = _settle(self, site, potential, clean=1.15, filthy=0.40, softness=0.36)
        dry = _mix((0.29, 0.195, 0.11), (0.19, 0.13, 0.08), _ramp(-0.3, 0.3, swept + patches + splashes))
        mud = _ramp(0.2, 1.0, depth)
        return _Painted(
            color=_mix(dry, (0.065, 0.038, 0.020), mud),
            alpha=0.92 * alpha,
            roughness=_slowly(self, site, 0.85, 0.95),
            metallic=np.zeros(len(alpha)),
            height=alpha * (0.0002 + 0.0012 * mud) * (1.0 + 1.5 * splashes),
        )


@dataclass(frozen=True)
class SmoothDust(_Smooth):
    """A pale film on surfaces that face up, thicker in corners and recesses, with faint runs down the sides.

    Attributes:
        amount: 0 is clean, 1 is thickly covered.
        cling: how much dust stays on steep surfaces.

    Raises:
        ConfigError: an option out of its range.
    """

    cling: float = number(0.35, 0.0, 1.0)

    def _painted(self, site: _Texels) -> _Painted:
        drifts = _noise(self, site, (4.0, 4.0, 4.0), 0, octaves=3)
        runs = _noise(self, site, (10.0, 1.5, 10.0), 1)
        upward = _ramp(-0.35, 0.95, site.normal[:, 1])
        steep = 1.0 - _ramp(0.3, 0.8, np.abs(site.normal[:, 1]))
        corners = _ramp(0.0, 0.8, -site.curvature) + 0.5 * (1.0 - site.visibility)
        worn = _ramp(0.2, 0.9, site.curvature)
        potential = (1.0 - self.cling) * upward + self.cling * (0.5 + 0.5 * upward) + 0.35 * corners * (0.4 + upward)
        potential = potential - 0.25 * worn + 0.55 * drifts + 0.45 * steep * runs
        potential = potential + 0.20 * _fine(self, site, 20.0, 3)
        # dust has no edges, so its softness stays
        alpha, depth = _settle(self, site, potential, clean=1.1, filthy=0.42, softness=0.7, sharpest=0.5)
        return _Painted(
            color=_mix((0.34, 0.285, 0.205), (0.50, 0.43, 0.32), _ramp(-0.2, 0.8, depth + 0.8 * drifts)),
            alpha=0.82 * alpha,
            roughness=_slowly(self, site, 0.92, 0.98),
            metallic=np.zeros(len(alpha)),
            height=np.zeros(len(alpha)),
        )


@dataclass(frozen=True)
class SmoothRust(_Smooth):
    """Corrosion that starts at edges, creases and recesses, spreads in blotches and stains the flanks below.

    Attributes:
        amount: 0 is intact metal, 1 is heavily rusted.
        bleed: strength of the runs below the blotches.

    Raises:
        ConfigError: an option out of its range.
    """

    metal: ClassVar[bool] = True
    bleed: float = number(1.0, 0.0, 2.0)

    def _painted(self, site: _Texels) -> _Painted:
        blotches = _noise(self, site, (5.0, 5.0, 5.0), 0, octaves=3)
        grain = _noise(self, site, (9.0, 9.0, 9.0), 1)
        exposed = 0.60 * _ramp(0.15, 0.8, site.curvature) + 0.30 * _ramp(0.1, 0.8, -site.curvature)
        damp = 0.50 * (1.0 - site.visibility) + 0.30 * _ramp(0.5, 0.0, site.height)
        core = exposed + damp + 1.5 * blotches + 0.5 * grain
        flakes, pits = _fine(self, site, 18.0, 3), _fine(self, site, 40.0, 4)
        core = core + 0.70 * flakes
        steep = 1.0 - _ramp(0.4, 0.9, np.abs(site.normal[:, 1]))
        bleeding = self.bleed * steep * self._runs(site)
        alpha, depth = _settle(self, site, core, clean=1.1, filthy=0.38, softness=0.30)
        stain, _ = _settle(self, site, bleeding + 0.5 * damp, clean=1.1, filthy=0.46, softness=0.45, sharpest=0.45)
        eaten = _ramp(-0.05, 0.55, depth + 0.4 * grain + pits)
        bright = _mix((0.40, 0.19, 0.065), (0.33, 0.095, 0.020), _ramp(-0.3, 0.1, depth + 0.5 * grain + flakes))
        rust = _mix(bright, (0.080, 0.027, 0.012), eaten)
        # around the rust, paint has come off and the sheet is still bare
        bare = self.detail * min(1.0, 4.0 * self.amount) * (1.0 - alpha)
        bare = bare * _ramp(-0.14, -0.06, depth) * _ramp(0.0, 0.10, flakes + 0.5 * pits)
        return _Painted(
            color=_mix(rust, _STEEL, bare),
            alpha=np.maximum(np.maximum(0.92 * alpha, 0.7 * stain), 0.95 * bare),
            roughness=_slowly(self, site, 0.7, 0.9) * (1.0 - bare) + 0.42 * bare,
            metallic=bare,
            height=0.0009 * alpha * (np.maximum(pits, -0.3) - 0.3 * eaten) - 0.0004 * bare,
        )

    def _runs(self, site: _Texels) -> Values:
        """Stains below blotches: the maximum of the blotch noise at a few heights above, weaker with distance."""
        narrow = 0.4 + 1.4 * _noise(self, site, (10.0, 1.0, 10.0), 2)
        falls = [(0.03, 1.0), (0.07, 0.85), (0.11, 0.7), (0.15, 0.5)]
        above = [fade * _noise(self, site, (5.0, 5.0, 5.0), 0, lift=lift, octaves=3) for lift, fade in falls]
        return 2.2 * np.maximum(np.max(above, axis=0), 0.0) * np.maximum(narrow, 0.0)


@dataclass(frozen=True)
class SmoothChips(_Smooth):
    """Paint chipped off edges, the front and the sills down to primer and bare steel, and scratches along the flanks.

    Attributes:
        amount: 0 is intact paint, 1 is heavily chipped.
        scratches: strength of the scratches.
        rust: how much of the bare steel has begun to rust.

    Raises:
        ConfigError: an option out of its range.
    """

    metal: ClassVar[bool] = True
    detail: float = number(1.0, 0.0, 1.0)
    scratches: float = number(1.0, 0.0, 2.0)
    rust: float = number(0.5, 0.0, 1.0)

    def _painted(self, site: _Texels) -> _Painted:
        patches = _noise(self, site, (5.0, 5.0, 5.0), 0, octaves=3)
        flakes, grain = _fine(self, site, 30.0, 1), _fine(self, site, 60.0, 2)
        edges = 0.60 * _ramp(0.1, 0.7, site.curvature)
        front = 0.35 * _ramp(0.2, 0.9, site.normal[:, 2]) * _ramp(0.0, 0.5, site.position[:, 2])
        sills = 0.35 * _ramp(0.40, 0.05, site.height)
        potential = edges + front + sills + 0.7 * patches + 1.3 * flakes
        alpha, depth = _settle(self, site, potential, clean=1.15, filthy=0.48, softness=0.30)
        scratch = self._scratches(site, patches)
        bare = _ramp(0.02, 0.10, depth) * alpha
        rusty = self.rust * _ramp(0.15, 0.55, depth + 0.5 * patches + grain)
        primer = _mix((0.24, 0.23, 0.22), (0.16, 0.15, 0.145), _ramp(-0.2, 0.2, grain))
        steel = _mix(_STEEL, (0.33, 0.31, 0.29), _ramp(-0.3, 0.3, flakes))
        rust = _mix((0.26, 0.095, 0.030), (0.10, 0.038, 0.016), _ramp(-0.2, 0.3, grain))
        metallic = np.maximum(bare * (1.0 - rusty), scratch * (1.0 - bare))
        rough = 0.62 + (0.85 - 0.62) * rusty * bare + 0.1 * grain
        return _Painted(
            color=_mix(_mix(_mix(primer, steel, np.maximum(bare, scratch)), rust, bare * rusty), _STEEL, 0.3 * scratch),
            alpha=np.maximum(alpha, scratch),
            roughness=np.clip(rough + (0.36 + 0.2 * np.abs(grain) - rough) * metallic, 0.0, 1.0),
            metallic=metallic,
            height=-0.0006 * alpha - 0.0003 * bare - 0.0004 * scratch + 0.0004 * grain * bare * rusty,
        )

    def _scratches(self, site: _Texels, patches: Values) -> Values:
        """Thin lines, about two texels wide: where stretched noise passes through zero, in some places only."""
        lines = _noise(self, site, (1.5, 24.0, 1.5), 3, octaves=1)
        width = 0.3 * 24.0 * 2.0 * math.pi * max(site.texel, 5e-4) / self.scale
        there = _ramp(0.20, 0.40, _noise(self, site, (3.0, 11.0, 3.0), 4) + 0.3 * patches + 0.3 * (self.amount - 0.5))
        there = there * min(1.0, 4.0 * self.amount) * min(1.0, self.scratches)
        return self.detail * there * _ramp(width, 0.4 * width, np.abs(lines))


def _noise(
    recipe: _Smooth,
    site: _Texels,
    frequency: tuple[float, float, float],
    stream: int,
    octaves: int = 2,
    lift: float = 0.0,
) -> Values:
    """Noise of `frequency` waves per vehicle length along x, y and z, sampled `lift` lengths higher; std. dev. 0.3."""
    points = (site.position + np.array([0.0, lift, 0.0])) * np.array(frequency) / recipe.scale
    return 1.8 * fbm(points, recipe.seed * 8 + stream, octaves=octaves)


def _spray(site: _Texels, height: Values) -> Values:
    """Dirt thrown up behind the wheels, in [0, 1]: it starts at the axle, and rises and fades towards the tail."""
    fans = np.zeros(len(height))
    for axle in site.axles:
        behind = axle - site.position[:, 2]
        fan = _ramp(-0.06, 0.08, behind) * np.exp(-np.maximum(behind, 0.0) / 0.16)
        fans = np.maximum(fans, fan * _ramp(0.95, 0.2, height - 0.6 * np.clip(behind, 0.0, 0.3)))
    return fans


def _fine(recipe: _Smooth, site: _Texels, frequency: float, stream: int) -> Values:
    """Noise from `frequency` waves per vehicle length down to four texels, times `detail`; std. dev. about 0.3."""
    if not recipe.detail:
        return np.zeros(len(site.position))
    finest = max(4.0 * site.texel, recipe.scale / (2**_MOST_OCTAVES * frequency))
    octaves = math.floor(math.log2(max(1.0, recipe.scale / (finest * frequency)))) + 1
    return recipe.detail * _noise(recipe, site, (frequency,) * 3, stream, octaves=octaves)


def _slowly(recipe: _Smooth, site: _Texels, least: float, greatest: float) -> Values:
    """Values between two bounds that vary slowly over the surface."""
    return least + (greatest - least) * _ramp(-0.6, 0.6, _noise(recipe, site, (6.0, 6.0, 6.0), 7))


def _settle(
    recipe: _Smooth,
    site: _Texels,
    potential: Values,
    *,
    clean: float,
    filthy: float,
    softness: float,
    sharpest: float = 0,
) -> tuple[Values, Values]:
    """Coverage in [0, 1], which never decreases with `amount`, and the potential minus the threshold.

    With detail, edges become sharper, down to `sharpest` or to two texels of a potential that rises by 15 per length.
    """
    sharp = min(softness, max(sharpest, 15.0 * site.texel, 0.02))
    softness = softness + (sharp - softness) * recipe.detail
    depth = potential - (clean + (filthy - clean) * recipe.amount)
    return min(1.0, 4.0 * recipe.amount) * _ramp(-softness, softness, depth), depth


def _ramp(start: float, end: float, value: Values) -> Values:
    """Smoothstep from 0 at `start` to 1 at `end`; `start` may be greater than `end`."""
    t = np.clip((value - start) / (end - start), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


_MOST_OCTAVES = 7
_STEEL = (0.46, 0.45, 0.43)
_Color = Float[ndarray, "texels 3"] | tuple[float, float, float]


def _mix(first: _Color, second: _Color, share: Values) -> Float[ndarray, "texels 3"]:
    return np.asarray(first) + share[:, None] * (np.asarray(second) - np.asarray(first))
