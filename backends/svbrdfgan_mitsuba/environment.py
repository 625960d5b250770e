"""The environment emitter: its radiance in any direction, and directions drawn where it is bright.

Mitsuba's own `envmap` is not used: it compiles the image's size into its kernels, and its rows are edge-aligned where
ours are centred (docs/conventions.md). Here one kernel serves every image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from svbrdfgan.types import Environment
from svbrdfgan_mitsuba.interop import dr, floats, wait_for_torch
from svbrdfgan_mitsuba.textures import Taps, bilinear_taps

_NUMBERS = 2**32


@dataclass(frozen=True, eq=False)
class EnvironmentEmitter:
    """An environment prepared for lookups and sampling. Directions are unit vectors towards the light.

    Attributes:
        texels: radiance of each pixel, and the density with which it is drawn over the unit square of (u, v).
        first: the first of the 2^32 numbers that draw each pixel.
        steps: of the binary search among them.
        rotation: its cosine and sine.
    """

    mi: Any
    texels: Any
    first: Any
    rows: Any
    cols: Any
    steps: Any
    rotation: tuple[Any, ...]

    @classmethod
    def of(cls, mi: Any, environment: Environment, device: torch.device) -> EnvironmentEmitter:
        """The emitter of the environment. The caller has checked its radiance."""
        rows, cols, _ = environment.radiance.shape
        wait_for_torch(device)
        texels, first = _tables(mi, floats(mi, environment.radiance, device), rows, cols)
        return cls(
            mi=mi,
            texels=texels,
            first=first,
            rows=dr.opaque(mi.UInt32, rows),
            cols=dr.opaque(mi.UInt32, cols),
            steps=dr.opaque(mi.UInt32, (rows * cols - 1).bit_length()),
            rotation=tuple(dr.opaque(mi.Float, f(environment.rotation)) for f in (math.cos, math.sin)),
        )

    def sample(self, number: Any, random: Any) -> Any:
        """Directions: a pixel is drawn by its share, then a point around its centre by the lookup's tent.

        A tent that reaches beyond a pole is folded back, because the lookup clamps there.
        """
        mi, pixel = self.mi, self._pixel(number)
        row = pixel // self.cols
        col = pixel - row * self.cols
        offset = mi.warp.square_to_tent(random)
        u = (mi.Float(col) + 0.5 + offset.x) / mi.Float(self.cols)
        v = (mi.Float(row) + 0.5 + offset.y) / mi.Float(self.rows)
        sine, cosine = dr.sincos(v * dr.pi)
        sine_azimuth, cosine_azimuth = dr.sincos((u - 0.5) * (2.0 * dr.pi))
        sine = dr.abs(sine)
        c, s = self.rotation
        x, z = sine * sine_azimuth, -sine * cosine_azimuth
        return mi.Vector3f(c * x + s * z, cosine, c * z - s * x)

    def evaluate(self, direction: Any, active: Any) -> tuple[Taps, Any, Any]:
        """The lookup in `texels` of each direction, its radiance, and its density in `sample`, per steradian."""
        mi, (c, s) = self.mi, self.rotation
        x, z = c * direction.x - s * direction.z, s * direction.x + c * direction.z
        sine = dr.sqrt(dr.fma(x, x, z * z))
        uv = mi.Point2f(0.5 + dr.atan2(x, -z) * (0.5 / dr.pi), dr.atan2(sine, direction.y) * (1.0 / dr.pi))
        taps = bilinear_taps(uv, mi.UInt32(0), self.cols, self.rows, (mi.Bool(True), mi.Bool(False)), active)
        value = taps.read(mi.Vector4f, self.texels)
        density = value.w / (2.0 * dr.pi**2 * dr.maximum(sine, 1e-12))  # finite at the poles
        return taps, mi.Color3f(value.x, value.y, value.z), density

    def _pixel(self, number: Any) -> Any:
        """The last pixel whose first number is at most this one, by binary search."""
        mi = self.mi
        low = dr.zeros(mi.UInt32, dr.width(number))
        state = (dr.zeros(mi.UInt32, dr.width(number)), low, low + self.rows * self.cols)

        def unfinished(step: Any, low: Any, high: Any) -> Any:
            return step < self.steps

        def halved(step: Any, low: Any, high: Any) -> tuple[Any, Any, Any]:
            middle = (low + high) >> 1
            reached = dr.gather(mi.UInt32, self.first, middle) <= number
            return step + 1, dr.select(reached, middle, low), dr.select(reached, high, middle)

        return dr.while_loop(state, unfinished, halved)[1]


def _tables(mi: Any, radiance: Any, rows: int, cols: int) -> tuple[Any, Any]:
    """`texels` and `first` of the emitter.

    Probabilities are multiples of 2^-32, so the density is exactly that of the drawn samples. The last pixel gets the
    rounding remainder.
    """
    count = rows * cols
    pixel = dr.arange(mi.UInt32, count)
    value = dr.gather(mi.Color3f, radiance, pixel)
    row = pixel // dr.opaque(mi.UInt32, cols)
    area = mi.Float64(dr.sin((mi.Float(row) + 0.5) * dr.opaque(mi.Float, math.pi / rows)))
    power = mi.Float64(value.x + value.y + value.z) * area
    total = _total(power)
    if total == 0.0:  # black: its gradient still needs samples
        power, total = area, _total(area)
    # Less one, so that the share of a pixel with all light fits into 32 bits.
    share = mi.UInt32(power * dr.opaque(mi.Float64, (_NUMBERS - 1) / total))
    first = dr.prefix_sum(share)
    last = pixel == dr.opaque(mi.UInt32, count - 1)
    drawn = dr.select(last, float(_NUMBERS) - mi.Float64(first), mi.Float64(share))
    density = mi.Float(drawn * dr.opaque(mi.Float64, count / _NUMBERS))
    texels = dr.ravel(mi.Vector4f(value.x, value.y, value.z, density))
    dr.eval(texels, first)
    return texels, first


def _total(power: Any) -> float:
    """The sum of all light, rounded to float32 so that the order of summation does not show, then enlarged a little.

    The result must not be below the exact sum: shares that sum to more than 2^32 would wrap around to zero.
    """
    return float(np.float32(dr.sum(power)[0])) * (1.0 + 1e-6)
