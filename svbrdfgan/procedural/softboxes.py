"""The light of a photographer's studio, as an environment map: soft boxes before dim walls."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.procedural.sky import pixels

_ROWS = 128
_WALLS = (0.25, 0.35)
"""Radiance of the surround at the horizon and overhead."""


@dataclass(frozen=True)
class Softbox:
    """A rectangle of light with soft edges. Angles in degrees, azimuth as for `Camera.orbit`.

    Attributes:
        azimuth, elevation: of its centre.
        width, height: along the horizon and across it, seen from the object.
        radiance: linear RGB in its middle.
        edge: over which it fades.
    """

    azimuth: float
    elevation: float
    width: float
    height: float
    radiance: tuple[float, float, float]
    edge: float = 8.0

    def light(self, direction: Float[ndarray, "rows cols 3"]) -> Float[ndarray, "rows cols 3"]:
        """Its radiance from these directions, which are unit vectors."""
        azimuth, elevation = math.radians(self.azimuth), math.radians(self.elevation)
        right = np.array([math.cos(azimuth), 0.0, -math.sin(azimuth)])
        flat = np.array([math.sin(azimuth), 0.0, math.cos(azimuth)])
        up = np.array([0.0, math.cos(elevation), 0.0]) - math.sin(elevation) * flat
        toward = np.array([0.0, math.sin(elevation), 0.0]) + math.cos(elevation) * flat
        across = np.degrees(np.arctan2(direction @ right, direction @ toward))
        along = np.degrees(np.arcsin(np.clip(direction @ up, -1.0, 1.0)))
        inside = self._fade(across, self.width) * self._fade(along, self.height)
        return inside[..., None] * np.asarray(self.radiance)

    def _fade(self, angle: ndarray, size: float) -> ndarray:
        x = np.clip((size / 2.0 - np.abs(angle)) / self.edge + 0.5, 0.0, 1.0)
        return x * x * (3.0 - 2.0 * x)


STUDIO = (
    Softbox(80.0, 42.0, 60.0, 50.0, (6.0, 5.9, 5.75)),
    Softbox(-30.0, 24.0, 80.0, 36.0, (2.3, 2.35, 2.4)),
    Softbox(0.0, 82.0, 50.0, 110.0, (3.0, 3.0, 3.0), edge=14.0),
    Softbox(-150.0, 22.0, 70.0, 18.0, (4.0, 4.05, 4.15)),
)
"""For a vehicle seen from azimuth 35: a large key on its flank, a weak fill before its nose, a bank overhead, and a
strip behind it for its edges."""


def build_studio(lights: tuple[Softbox, ...] = STUDIO) -> Float[Tensor, "rows cols 3"]:
    """An equirectangular map of linear radiance, oriented as in `docs/conventions.md`."""
    direction, _ = pixels(_ROWS, 2 * _ROWS)
    horizon, zenith = _WALLS
    walls = horizon + (zenith - horizon) * np.clip(direction[..., 1:2], 0.0, 1.0)
    return torch.from_numpy(sum((box.light(direction) for box in lights), walls + np.zeros(3)).astype(np.float32))
