"""What the maps say at the vertices of paths; and, by the chain rule, what depends on their texels."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.types import LEAST_ROUGHNESS
from svbrdfgan_numpy.bounce import Bounce, Reflection
from svbrdfgan_numpy.glossy import lobe, lobe_slope
from svbrdfgan_numpy.taps import Taps
from svbrdfgan_numpy.texture import Texture

Rgb = Float[ndarray, "_ 3"]
Values = Float[ndarray, "_ channels"]
"""One channel for all three colours, or three."""


@dataclass(frozen=True, eq=False)
class Shading:
    """A bounce with materials and light.

    Attributes:
        values: of each of its reflections.
        lights: gathered by each of them, per unit of value.
    """

    values: Sequence[Values]
    lights: Sequence[Rgb]


def shade(bounce: Bounce, maps: Mapping[str, Texture], environment: Float[ndarray, "pixels 3"]) -> Shading:
    """The bounce under the environment, made of materials with these maps."""
    values = [_lookup(bounce, maps["base_color"], bounce.diffuse).apply(maps["base_color"].texels)]
    for gloss in bounce.gloss:
        roughness = _lookup(bounce, maps["roughness"], gloss.reflection).apply(maps["roughness"].texels)[:, 0]
        values.append(lobe(gloss.cosines, _alpha(roughness))[:, None])
    return Shading(values, [reflection.light.apply(environment) for reflection in bounce.reflections])


def shade_vjp(
    bounce: Bounce, maps: Mapping[str, Texture], grad_values: Sequence[Values]
) -> Iterator[tuple[str, Taps, Values]]:
    """The gradients in what each lookup of a map gave, from those in the values of `shade`."""
    yield "base_color", _lookup(bounce, maps["base_color"], bounce.diffuse), grad_values[0]
    for gloss, grad in zip(bounce.gloss, grad_values[1:], strict=True):
        taps = _lookup(bounce, maps["roughness"], gloss.reflection)
        roughness = taps.apply(maps["roughness"].texels)[:, 0]
        slope = lobe_slope(gloss.cosines, _alpha(roughness)) * _alpha_slope(roughness)
        yield "roughness", taps, grad * slope[:, None]


def _lookup(bounce: Bounce, texture: Texture, reflection: Reflection) -> Taps:
    return texture.taps(bounce.part[reflection.vertex], bounce.uv[reflection.vertex])


def _alpha(roughness: Float[ndarray, " points"]) -> Float[ndarray, " points"]:
    return np.maximum(roughness, LEAST_ROUGHNESS) ** 2


def _alpha_slope(roughness: Float[ndarray, " points"]) -> Float[ndarray, " points"]:
    return np.where(roughness < LEAST_ROUGHNESS, 0.0, 2.0 * roughness)
