"""Weathering recipes: each computes a colour and an alpha per texel from the geometry of a site.

A recipe first computes a potential, which is greatest where its matter settles first. Matter shows where the potential
exceeds a threshold that falls as `amount` grows, so coverage never decreases with `amount`. At scale 1 the finest
wavelength is a twentieth of the vehicle's length (several texels at 128 x 128) and has a small amplitude, so that a
network that sees position and normal can reproduce it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Protocol

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.weathering.noise import fbm
from svbrdfgan.weathering.ranges import check_ranges, number
from svbrdfgan.weathering.site import Site

Matter = Mapping[str, tuple[float, float]]
"""The least and the greatest value of the matter in each further map, by the map's name. It has no relief so far."""


class Recipe(Protocol):
    """A frozen record of options, with a method that paints a site."""

    matter: ClassVar[Matter]

    @property
    def amount(self) -> float: ...

    @property
    def seed(self) -> int: ...

    @property
    def scale(self) -> float: ...

    def paint(self, site: Site) -> Float[ndarray, "texels 4"]:
        """Linear RGB and straight alpha in [0, 1], a pure function of the site. `amount` 0 gives alpha 0."""
        ...


@dataclass(frozen=True)
class RoadDirt:
    """Mud and road film: strongest on the sills, behind the wheels, along the flanks and on the tail.

    Attributes:
        amount: 0 is clean, 1 is filthy.
        seed: selects another pattern of the same kind.
        scale: size of the pattern, relative to the default.
        reach: height up to which the dirt reaches, in heights of the vehicle.
        spray: strength of the dirt behind the wheels.

    Raises:
        ConfigError: an option out of its range.
    """

    matter: ClassVar[Matter] = MappingProxyType({"roughness": (0.85, 0.95), "metallic": (0.0, 0.0)})

    amount: float = number(0.8, 0.0, 1.0)
    seed: int = number(0, 0, 2**31 - 1)
    scale: float = number(1.0, 0.25, 4.0)
    reach: float = number(0.65, 0.1, 1.5)
    spray: float = number(1.0, 0.0, 2.0)

    def __post_init__(self) -> None:
        check_ranges(self)

    def paint(self, site: Site) -> Float[ndarray, "texels 4"]:
        """Linear RGB and straight alpha in [0, 1]."""
        patches = _noise(self, site, (5.0, 5.0, 5.0), 0, octaves=3)
        runs = _noise(self, site, (10.0, 1.8, 10.0), 1)
        swept = _noise(self, site, (6.0, 10.0, 2.5), 2)
        height = site.height + 0.20 * patches + 0.12 * runs
        low = _ramp(1.3 * self.reach, -0.1, height)
        thrown = self.spray * _spray(site, height) * (0.9 + 1.2 * swept)
        wake = 0.40 * _ramp(0.3, 1.0, -site.normal[:, 2]) * _ramp(1.1, 0.2, height)
        sheltered = 0.25 * (1.0 - site.visibility) * _ramp(0.9, 0.3, site.height)
        lying = 1.0 - 0.55 * _ramp(0.5, 0.95, site.normal[:, 1]) * _ramp(0.1, 0.4, site.height)
        potential = lying * (0.85 * low + 1.00 * thrown + wake + sheltered) + 0.65 * patches + 0.30 * runs
        alpha, depth = _settle(potential, self.amount, clean=1.15, filthy=0.40, softness=0.36)
        dry = _mix((0.29, 0.195, 0.11), (0.19, 0.13, 0.08), _ramp(-0.3, 0.3, swept + patches))
        return _layer(_mix(dry, (0.065, 0.038, 0.020), _ramp(0.2, 1.0, depth)), 0.92 * alpha)


@dataclass(frozen=True)
class Dust:
    """A pale film on surfaces that face up, thicker in corners and recesses, with faint runs down the sides.

    Attributes:
        amount: 0 is clean, 1 is thickly covered.
        seed: selects another pattern of the same kind.
        scale: size of the pattern, relative to the default.
        cling: how much dust stays on steep surfaces.

    Raises:
        ConfigError: an option out of its range.
    """

    matter: ClassVar[Matter] = MappingProxyType({"roughness": (0.92, 0.98), "metallic": (0.0, 0.0)})

    amount: float = number(0.8, 0.0, 1.0)
    seed: int = number(0, 0, 2**31 - 1)
    scale: float = number(1.0, 0.25, 4.0)
    cling: float = number(0.35, 0.0, 1.0)

    def __post_init__(self) -> None:
        check_ranges(self)

    def paint(self, site: Site) -> Float[ndarray, "texels 4"]:
        """Linear RGB and straight alpha in [0, 1]."""
        drifts = _noise(self, site, (4.0, 4.0, 4.0), 0, octaves=3)
        runs = _noise(self, site, (10.0, 1.5, 10.0), 1)
        upward = _ramp(-0.35, 0.95, site.normal[:, 1])
        steep = 1.0 - _ramp(0.3, 0.8, np.abs(site.normal[:, 1]))
        corners = _ramp(0.0, 0.8, -site.curvature) + 0.5 * (1.0 - site.visibility)
        worn = _ramp(0.2, 0.9, site.curvature)
        potential = (1.0 - self.cling) * upward + self.cling * (0.5 + 0.5 * upward) + 0.35 * corners * (0.4 + upward)
        potential = potential - 0.25 * worn + 0.55 * drifts + 0.45 * steep * runs
        alpha, depth = _settle(potential, self.amount, clean=1.1, filthy=0.42, softness=0.7)
        color = _mix((0.34, 0.285, 0.205), (0.50, 0.43, 0.32), _ramp(-0.2, 0.8, depth + 0.8 * drifts))
        return _layer(color, 0.82 * alpha)


@dataclass(frozen=True)
class Rust:
    """Corrosion that starts at edges, creases and recesses, spreads in blotches and stains the flanks below.

    Attributes:
        amount: 0 is intact metal, 1 is heavily rusted.
        seed: selects another pattern of the same kind.
        scale: size of the pattern, relative to the default.
        bleed: strength of the runs below the blotches.

    Raises:
        ConfigError: an option out of its range.
    """

    matter: ClassVar[Matter] = MappingProxyType({"roughness": (0.7, 0.9), "metallic": (0.0, 0.0)})

    amount: float = number(0.8, 0.0, 1.0)
    seed: int = number(0, 0, 2**31 - 1)
    scale: float = number(1.0, 0.25, 4.0)
    bleed: float = number(1.0, 0.0, 2.0)

    def __post_init__(self) -> None:
        check_ranges(self)

    def paint(self, site: Site) -> Float[ndarray, "texels 4"]:
        """Linear RGB and straight alpha in [0, 1]."""
        blotches = _noise(self, site, (5.0, 5.0, 5.0), 0, octaves=3)
        grain = _noise(self, site, (9.0, 9.0, 9.0), 1)
        exposed = 0.60 * _ramp(0.15, 0.8, site.curvature) + 0.30 * _ramp(0.1, 0.8, -site.curvature)
        damp = 0.50 * (1.0 - site.visibility) + 0.30 * _ramp(0.5, 0.0, site.height)
        core = exposed + damp + 1.5 * blotches + 0.5 * grain
        steep = 1.0 - _ramp(0.4, 0.9, np.abs(site.normal[:, 1]))
        bleeding = self.bleed * steep * self._runs(site)
        alpha, depth = _settle(core, self.amount, clean=1.1, filthy=0.38, softness=0.30)
        stain, _ = _settle(bleeding + 0.5 * damp, self.amount, clean=1.1, filthy=0.46, softness=0.45)
        eaten = _ramp(-0.05, 0.55, depth + 0.4 * grain)
        bright = _mix((0.40, 0.19, 0.065), (0.33, 0.095, 0.020), _ramp(-0.3, 0.1, depth + 0.5 * grain))
        return _layer(_mix(bright, (0.080, 0.027, 0.012), eaten), np.maximum(0.92 * alpha, 0.7 * stain))

    def _runs(self, site: Site) -> Float[ndarray, " texels"]:
        """Stains below blotches: the maximum of the blotch noise at a few heights above, weaker with distance."""
        narrow = 0.4 + 1.4 * _noise(self, site, (10.0, 1.0, 10.0), 2)
        falls = [(0.03, 1.0), (0.07, 0.85), (0.11, 0.7), (0.15, 0.5)]
        above = [fade * _noise(self, site, (5.0, 5.0, 5.0), 0, lift=lift, octaves=3) for lift, fade in falls]
        return 2.2 * np.maximum(np.max(above, axis=0), 0.0) * np.maximum(narrow, 0.0)


def matter(recipe: Recipe, site: Site, name: str) -> Float[ndarray, "texels channels"]:
    """The matter's value in the map `name` at each texel. It varies slowly over the surface; a `normal` is flat."""
    if name == "normal":
        return np.tile([0.0, 0.0, 1.0], (len(site.position), 1))
    least, greatest = recipe.matter[name]
    return (least + (greatest - least) * _ramp(-0.6, 0.6, _noise(recipe, site, (6.0, 6.0, 6.0), 7)))[:, None]


RECIPES: Mapping[str, type[Recipe]] = MappingProxyType({"road-dirt": RoadDirt, "dust": Dust, "rust": Rust})
"""Recipe classes by their names in configuration files and on the command line."""


def _noise(
    recipe: Recipe,
    site: Site,
    frequency: tuple[float, float, float],
    stream: int,
    octaves: int = 2,
    lift: float = 0.0,
) -> Float[ndarray, " texels"]:
    """Noise of `frequency` waves per vehicle length along x, y and z, sampled `lift` lengths higher; std. dev. 0.3."""
    points = (site.position + np.array([0.0, lift, 0.0])) * np.array(frequency) / recipe.scale
    return 1.8 * fbm(points, recipe.seed * 8 + stream, octaves=octaves)


def _spray(site: Site, height: Float[ndarray, " texels"]) -> Float[ndarray, " texels"]:
    """Dirt thrown up behind the wheels, in [0, 1]: it starts at the axle, and rises and fades towards the tail."""
    fans = np.zeros(len(height))
    for axle in site.axles:
        behind = axle - site.position[:, 2]
        fan = _ramp(-0.06, 0.08, behind) * np.exp(-np.maximum(behind, 0.0) / 0.16)
        fans = np.maximum(fans, fan * _ramp(0.95, 0.2, height - 0.6 * np.clip(behind, 0.0, 0.3)))
    return fans


def _settle(
    potential: Float[ndarray, " texels"], amount: float, *, clean: float, filthy: float, softness: float
) -> tuple[Float[ndarray, " texels"], Float[ndarray, " texels"]]:
    """Coverage in [0, 1], which never decreases with `amount`, and the potential minus the threshold."""
    depth = potential - (clean + (filthy - clean) * amount)
    return min(1.0, 4.0 * amount) * _ramp(-softness, softness, depth), depth


def _ramp(start: float, end: float, value: Float[ndarray, " texels"]) -> Float[ndarray, " texels"]:
    """Smoothstep from 0 at `start` to 1 at `end`; `start` may be greater than `end`."""
    t = np.clip((value - start) / (end - start), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


_Color = Float[ndarray, "texels 3"] | tuple[float, float, float]


def _mix(first: _Color, second: _Color, share: Float[ndarray, " texels"]) -> Float[ndarray, "texels 3"]:
    return np.asarray(first) + share[:, None] * (np.asarray(second) - np.asarray(first))


def _layer(color: Float[ndarray, "texels 3"], alpha: Float[ndarray, " texels"]) -> Float[ndarray, "texels 4"]:
    return np.concatenate([color, alpha[:, None]], axis=1)
