"""Vehicle kinds: the parameter ranges of each, and random vehicles drawn from them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from svbrdfgan.errors import ConfigError
from svbrdfgan.procedural.shape import LIMITS, Range, VehicleShape

_CAR: Mapping[str, Range] = MappingProxyType(
    {
        "clearance": (0.035, 0.05),
        "wheel_radius": (0.066, 0.080),
        "wheel_width": (0.045, 0.058),
        "wheelbase": (0.56, 0.63),
        "front_overhang": (0.165, 0.20),
        "hood_rise": (0.03, 0.06),
        "roof_arch": (0.006, 0.018),
        "roof_drop": (0.0, 0.02),
        "belt_rise": (0.0, 0.02),
        "tumblehome": (0.22, 0.45),
        "bow": (0.02, 0.05),
        "taper": (0.05, 0.16),
        "flare": (0.002, 0.012),
        "rounding": (0.007, 0.02),
        "cladding": (0.0, 0.0),
        "lamps": (0.14, 0.26),
    }
)

_RANGES: Mapping[str, Mapping[str, Range]] = MappingProxyType(
    {
        "sedan": {
            **_CAR,
            "width": (0.38, 0.47),
            "height": (0.285, 0.36),
            "nose": (0.50, 0.57),
            "hood_length": (0.24, 0.31),
            "windscreen_run": (0.12, 0.17),
            "rear_run": (0.11, 0.18),
            "deck_length": (0.09, 0.17),
            "deck": (0.62, 0.69),
            "glazing": (1.0, 1.0),
        },
        "hatchback": {
            **_CAR,
            "width": (0.42, 0.49),
            "height": (0.35, 0.42),
            "wheel_radius": (0.076, 0.09),
            "nose": (0.48, 0.55),
            "hood_length": (0.19, 0.26),
            "windscreen_run": (0.12, 0.18),
            "rear_run": (0.07, 0.20),
            "roof_drop": (0.005, 0.035),
            "front_overhang": (0.15, 0.175),
            "wheelbase": (0.60, 0.66),
            "deck_length": (0.0, 0.04),
            "deck": (0.60, 0.66),
            "glazing": (0.85, 1.0),
        },
        "suv": {
            **_CAR,
            "width": (0.40, 0.50),
            "height": (0.35, 0.46),
            "clearance": (0.055, 0.075),
            "wheel_radius": (0.078, 0.092),
            "nose": (0.54, 0.60),
            "hood_length": (0.22, 0.28),
            "windscreen_run": (0.08, 0.13),
            "rear_run": (0.03, 0.08),
            "deck_length": (0.0, 0.03),
            "deck": (0.62, 0.68),
            "tumblehome": (0.12, 0.28),
            "cladding": (0.0, 0.025),
            "glazing": (0.9, 1.0),
        },
        "van": {
            **_CAR,
            "width": (0.37, 0.45),
            "height": (0.38, 0.48),
            "wheel_radius": (0.062, 0.074),
            "front_overhang": (0.15, 0.18),
            "wheelbase": (0.58, 0.64),
            "nose": (0.42, 0.50),
            "hood_length": (0.11, 0.17),
            "hood_rise": (0.04, 0.07),
            "windscreen_run": (0.11, 0.17),
            "rear_run": (0.02, 0.05),
            "deck_length": (0.0, 0.03),
            "deck": (0.56, 0.64),
            "tumblehome": (0.06, 0.18),
            "taper": (0.02, 0.08),
            "roof_arch": (0.004, 0.012),
            "glazing": (0.22, 1.0),
        },
        "pickup": {
            **_CAR,
            "width": (0.37, 0.44),
            "height": (0.31, 0.40),
            "clearance": (0.055, 0.08),
            "wheel_radius": (0.07, 0.085),
            "wheelbase": (0.57, 0.63),
            "nose": (0.58, 0.64),
            "hood_length": (0.22, 0.28),
            "hood_rise": (0.015, 0.035),
            "windscreen_run": (0.08, 0.12),
            "rear_run": (0.015, 0.035),
            "deck_length": (0.27, 0.40),
            "deck": (0.58, 0.66),
            "roof_arch": (0.004, 0.012),
            "tumblehome": (0.15, 0.30),
            "taper": (0.02, 0.08),
            "rounding": (0.008, 0.015),
            "glazing": (1.0, 1.0),
            "cladding": (0.0, 0.02),
        },
    }
)

_GREYS = ((0.75, 0.75, 0.74), (0.45, 0.46, 0.48), (0.18, 0.185, 0.20), (0.04, 0.04, 0.042))
_COLOURS = (
    (0.50, 0.015, 0.015),
    (0.18, 0.008, 0.012),
    (0.65, 0.16, 0.015),
    (0.75, 0.48, 0.02),
    (0.02, 0.11, 0.045),
    (0.30, 0.55, 0.40),
    (0.02, 0.22, 0.24),
    (0.15, 0.40, 0.68),
    (0.015, 0.07, 0.38),
    (0.01, 0.025, 0.11),
    (0.18, 0.03, 0.12),
    (0.20, 0.11, 0.055),
    (0.55, 0.45, 0.30),
)

KINDS: tuple[str, ...] = tuple(_RANGES)
"""The kinds that `sample_vehicle` accepts."""


def sample_vehicle(kind: str, seed: int) -> VehicleShape:
    """A random vehicle of one of `KINDS`; the same seed gives the same vehicle.

    Raises:
        ConfigError: the kind is unknown, or the seed is negative.
    """
    if kind not in _RANGES:
        raise ConfigError(f"vehicle kind {kind!r} is unknown; known are {', '.join(KINDS)}.")
    if seed < 0:
        raise ConfigError(f"vehicle seed is {seed}; wanted 0 or more.")
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    numbers = {name: float(rng.uniform(*_RANGES[kind][name])) for name in LIMITS}
    return VehicleShape(**numbers, open_bed=kind == "pickup", paint=_sample_paint(rng))


def _sample_paint(rng: np.random.Generator) -> tuple[float, float, float]:
    """A random linear RGB paint: white, grey or black with probability 0.4, else one of `_COLOURS`, slightly varied."""
    greys = rng.random() < 0.4
    chosen = _GREYS[rng.integers(len(_GREYS))] if greys else _COLOURS[rng.integers(len(_COLOURS))]
    shade = rng.uniform(0.8, 1.2) * (1.0 if greys else rng.uniform(0.88, 1.12, 3)) * np.array(chosen)
    red, green, blue = (float(channel) for channel in np.clip(shade, 0.0, 0.9))
    return (red, green, blue)
