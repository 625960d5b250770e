"""Light from infinitely far away: its radiance, and directions drawn where it is bright.

Mitsuba's own `envmap` compiles the image's size into its kernels, and its rows are spaced otherwise than ours
(docs/conventions.md); here one kernel serves every image.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from svbrdfgan.types import Environment
from svbrdfgan_mitsuba.interop import floats, wait_for_torch
from svbrdfgan_mitsuba.jit import dr
from svbrdfgan_mitsuba.textures import Taps, taps

_NUMBERS = 2**32


@dataclass(frozen=True, eq=False)
class Light:
    """An environment made ready for lookups and sampling; directions are unit vectors towards the light.

    Attributes:
        texels: radiance of each pixel, and its share of the samples as density over the unit square of (u, v).
        first: the first of the 2^32 numbers that draw each pixel.
        steps: of the search among them.
        turn: cosine and sine of the rotation.
    """

    mi: Any
    texels: Any
    first: Any
    rows: Any
    cols: Any
    steps: Any
    turn: tuple[Any, ...]

    @classmethod
    def of(cls, mi: Any, environment: Environment, device: torch.device) -> Light:
        """The environment, ready."""
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
            turn=tuple(dr.opaque(mi.Float, f(environment.rotation)) for f in (math.cos, math.sin)),
        )

    def sample(self, number: Any, random: Any) -> Any:
        """Directions: a pixel is drawn by its share, then a point around its centre by the tent of the lookup.

        Beyond a pole the tent is folded back, which is what clamping does to the lookup.
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
        c, s = self.turn
        x, z = sine * sine_azimuth, -sine * cosine_azimuth
        return mi.Vector3f(c * x + s * z, cosine, c * z - s * x)

    def look(self, direction: Any, active: Any) -> tuple[Taps, Any, Any]:
        """What each direction reads of `texels`, the radiance it finds, and the density of `sample` per steradian."""
        mi, (c, s) = self.mi, self.turn
        x, z = c * direction.x - s * direction.z, s * direction.x + c * direction.z
        sine = dr.sqrt(dr.fma(x, x, z * z))
        uv = mi.Point2f(0.5 + dr.atan2(x, -z) * (0.5 / dr.pi), dr.atan2(sine, direction.y) * (1.0 / dr.pi))
        read = taps(uv, mi.UInt32(0), self.cols, self.rows, (mi.Bool(True), mi.Bool(False)), active)
        value = read.read(mi.Vector4f, self.texels)
        density = value.w / (2.0 * dr.pi**2 * dr.maximum(sine, 1e-12))
        return read, mi.Color3f(value.x, value.y, value.z), density

    def _pixel(self, number: Any) -> Any:
        """The last pixel whose first number is not greater: by halving, in as many steps as the image needs."""
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
    """`Light.texels` and `Light.first`.

    Probabilities are whole numbers of 2^-32, so that the density used is exactly the one drawn from. What is rounded
    off goes to the last pixel.
    """
    count = rows * cols
    pixel = dr.arange(mi.UInt32, count)
    value = dr.gather(mi.Color3f, radiance, pixel)
    row = pixel // dr.opaque(mi.UInt32, cols)
    area = mi.Float64(dr.sin((mi.Float(row) + 0.5) * dr.opaque(mi.Float, math.pi / rows)))
    power = mi.Float64(value.x + value.y + value.z) * area
    total = _total(power)
    if total == 0.0:
        power, total = area, _total(area)
    share = mi.UInt32(power * dr.opaque(mi.Float64, (_NUMBERS - 1) / total))
    first = dr.prefix_sum(share)
    last = pixel == dr.opaque(mi.UInt32, count - 1)
    drawn = dr.select(last, float(_NUMBERS) - mi.Float64(first), mi.Float64(share))
    density = mi.Float(drawn * dr.opaque(mi.Float64, count / _NUMBERS))
    texels = dr.ravel(mi.Vector4f(value.x, value.y, value.z, density))
    dr.eval(texels, first)
    return texels, first


def _total(power: Any) -> float:
    """All the light there is, and a hair more: rounded, so that the order of summation does not show, and never less
    than the truth, since shares that sum to more than 2^32 begin anew at zero."""
    return float(np.float32(dr.sum(power)[0])) * (1.0 + 1e-6)
