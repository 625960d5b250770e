"""Procedural indoor environment maps: a few lamps overhead, and a uniform term for light from walls and floor."""

from __future__ import annotations

import math

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.procedural.sky import pixels, plane_radiance

_LAMPS = np.array([(1.0, 0.55, 0.24), (1.0, 0.72, 0.46), (0.94, 1.0, 0.90), (0.80, 0.93, 1.0)])
"""Linear colours: tungsten, warm white, fluorescent, cold LED."""


def build_room(seed: int, rows: int = 64, cols: int = 128) -> Float[Tensor, "rows cols 3"]:
    """An equirectangular map of linear radiance, oriented as in `docs/conventions.md`.

    The same seed gives the same map. It is scaled so that a white horizontal Lambertian plane has a radiance of 1 (mean
    of the channels).

    Raises:
        ConfigError: the seed is negative.
    """
    if seed < 0:
        raise ConfigError(f"room seed is {seed}; wanted 0 or more.")
    rng = np.random.default_rng([seed, 0x4C3])
    direction, solid_angle = pixels(rows, cols)
    lamps = np.zeros(direction.shape)
    for _ in range(int(rng.integers(2, 6))):
        lamps += _lamp(rng, direction)
    walls = rng.uniform(0.05, 0.3) * rng.uniform(0.6, 1.0, size=3) * plane_radiance(lamps, direction, solid_angle)
    floor = rng.uniform(0.3, 1.0) * np.clip(0.5 - 2.0 * direction[..., 1:2], 0.0, 1.0)
    radiance = lamps + walls * (1.0 - floor)
    return torch.from_numpy((radiance / plane_radiance(radiance, direction, solid_angle).mean()).astype(np.float32))


def _lamp(rng: np.random.Generator, direction: Float[np.ndarray, "rows cols 3"]) -> Float[np.ndarray, "rows cols 3"]:
    """Radiance of a lamp: a soft disc of 8 to 25 degrees in diameter, 30 to 85 degrees above the horizon."""
    azimuth, elevation = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(30.0, 85.0))
    size, color = math.radians(rng.uniform(4.0, 12.5)), _LAMPS[rng.integers(len(_LAMPS))]
    flat = math.cos(elevation)
    towards = (flat * math.sin(azimuth), math.sin(elevation), flat * math.cos(azimuth))
    disc = np.exp((direction @ towards - 1.0) / (0.5 * size**2))[..., None]
    return rng.uniform(0.3, 1.0) / size**2 * disc * color * (direction[..., 1:2] > 0.0)
