"""The three profiles that define a vehicle body: side view, top view and cross-section."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.ndimage import gaussian_filter1d

from svbrdfgan.procedural.shape import VehicleShape

_SAMPLES = 2001
_CORNER = 0.055  # radius of the body's corners, seen from above
_ARCH_POWER = 2.3


@dataclass(frozen=True)
class Outline:
    """Heights and half-widths of a body as vectorised functions of z (along the vehicle) and y (height)."""

    shape: VehicleShape

    @property
    def landmarks(self) -> Float[ndarray, "8 2"]:
        """Corners (z, y) of the side view's upper edge, from the tail to the nose.

        In order: tail, rear end of the deck, foot of the rear glass, rear end of the roof, front end of the roof,
        cowl, front edge of the hood, nose.
        """
        s = self.shape
        top = s.height - s.roof_arch
        cowl, deck = s.nose * s.height + s.hood_rise, s.deck * s.height
        roof, rear = 0.5 - s.hood_length - s.windscreen_run, -0.5 + max(s.deck_length, 0.03)
        bumper = s.clearance + 0.5 * (s.nose * s.height - s.clearance)
        return np.array(
            [
                (-0.5, s.clearance + 0.55 * (deck - s.clearance)),
                (-0.48, deck - 0.01),
                (rear, deck),
                (rear + s.rear_run, top - s.roof_drop),
                (roof, top),
                (0.5 - s.hood_length, cowl),
                (0.5 - 0.035, s.nose * s.height),
                (0.5, bumper),
            ]
        )

    @cached_property
    def _top_samples(self) -> tuple[ndarray, ndarray]:
        z = np.linspace(-0.5, 0.5, _SAMPLES)
        corners = self.landmarks
        bulge = np.array([0.012, 0.002, 0.004, self.shape.roof_arch, 0.006, 0.008, 0.012])
        y = np.interp(z, corners[:, 0], corners[:, 1])
        segment = np.clip(np.searchsorted(corners[:, 0], z, side="right") - 1, 0, 6)
        start, end = corners[segment, 0], corners[segment + 1, 0]
        u = (z - start) / np.maximum(end - start, 1e-9)
        y = y + 4.0 * u * (1.0 - u) * bulge[segment]
        return z, gaussian_filter1d(y, 0.5 * self.shape.rounding * _SAMPLES, mode="nearest")

    def top(self, z: ndarray) -> ndarray:
        """Height of the body's upper edge on the centre line."""
        return np.interp(z, *self._top_samples)

    def belt(self, z: ndarray) -> ndarray:
        """Height of the belt line, which separates the body's side from the cabin."""
        start = 0.5 - self.shape.hood_length
        cowl = self.landmarks[5, 1]
        return cowl - 0.004 + self.shape.belt_rise * np.clip((start - np.asarray(z)) / 0.6, 0.0, 1.0)

    @property
    def arch_radius(self) -> float:
        return 1.22 * self.shape.wheel_radius

    def floor(self, z: ndarray) -> ndarray:
        """Height of the underside. It rises towards the nose and the tail, beyond the wheel arches."""
        front, rear = self.shape.axles
        beyond = np.maximum(np.maximum(z - front - self.arch_radius, rear - self.arch_radius - z), 0.0)
        share = np.clip(beyond / 0.05, 0.0, 1.0)
        return self.shape.clearance + 0.02 * share * share * (3.0 - 2.0 * share)

    def low(self, z: ndarray) -> ndarray:
        """Height of the side's lower edge: the sill, raised at the wheel arches."""
        rise = self.shape.wheel_radius + self.arch_radius - self.shape.clearance
        edge = self.floor(z)
        for axle in self.shape.axles:
            u = np.clip(np.abs(z - axle) / self.arch_radius, 0.0, 1.0)
            edge = edge + rise * (1.0 - u**_ARCH_POWER) ** (1.0 / _ARCH_POWER)
        return edge

    def arch_stations(self, count: int) -> Float[ndarray, " stations"]:
        """z of `count` cross-sections per wheel arch, spaced so that they sample its curve evenly."""
        c = np.cos(np.linspace(0.0, np.pi, count))
        u = np.sign(c) * np.abs(c) ** (2.0 / _ARCH_POWER)
        return np.concatenate([axle + self.arch_radius * u for axle in self.shape.axles])

    def half_width(self, z: ndarray, y: ndarray) -> ndarray:
        """Distance of the body's side from the plane x = 0."""
        s = self.shape
        belt = self.belt(z)
        v = np.clip((y - s.clearance) / (belt - s.clearance), 0.0, 1.0)
        tuck = 0.07 * np.clip((0.4 - v) / 0.4, 0.0, 1.0) ** 2 + 0.05 * np.clip((v - 0.62) / 0.38, 0.0, 1.0) ** 2
        above = np.maximum(y - belt, 0.0)
        lean = s.tumblehome * above + 0.6 * above**2 + 0.006 * np.clip(above / 0.008, 0.0, 1.0)
        return self._plan(z) * (1.0 - tuck) - lean + self._fenders(z, y)

    def _plan(self, z: ndarray) -> ndarray:
        """Half-width in the top view, with tapered ends and rounded corners."""
        s = self.shape
        z = np.asarray(z)
        body = 0.5 * s.width * (1.0 - s.taper * np.abs(2.0 * z) ** 3.5)
        past = np.clip((np.abs(z) - 0.5 + _CORNER) / _CORNER, 0.0, 1.0)
        return body - 1.3 * _CORNER * (1.0 - np.sqrt(1.0 - 0.97 * past**2))

    def _fenders(self, z: ndarray, y: ndarray) -> ndarray:
        """Additional half-width around the wheel arches."""
        bulge = np.zeros(np.broadcast_shapes(np.shape(z), np.shape(y)))
        for axle in self.shape.axles:
            distance = np.hypot(z - axle, y - self.shape.wheel_radius) / self.arch_radius
            bulge = bulge + np.exp(-((np.maximum(distance - 1.0, 0.0) / 0.28) ** 2))
        return self.shape.flare * bulge

    def bowed(self, positions: Float[ndarray, "vertices 3"]) -> Float[ndarray, "vertices 3"]:
        """The positions, with nose and tail bent back towards the sides (`VehicleShape.bow`)."""
        x, y, z = positions.T
        shift = 4.0 * self.shape.bow * z * np.abs(z) * (2.0 * x / self.shape.width) ** 2
        return np.stack([x, y, z - shift], axis=1)
