"""The radiance that paths carry, from their vertices, the maps and the light; and its gradient.

With v_j the values of the reflections at vertex k, e_j the light that they gather and t_j the weights of what the path
meets next, the radiance that leaves the vertex is L_k = sum_j v_j (e_j + t_j L_(k+1)). The camera sees L_0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.types import LEAST_ROUGHNESS
from svbrdfgan_numpy.glossy import Cosines, lobe, lobe_slope
from svbrdfgan_numpy.textures import Taps, Texture

Rgb = Float[ndarray, "_ 3"]
Values = Float[ndarray, "_ channels"]
"""Of one channel for all three colours, or of three."""


@dataclass(frozen=True, eq=False)
class Reflection:
    """One summand of the light that leaves some vertices: value * (light + onward * what the path meets next).

    The value is the only factor that depends on materials: the base colour, or the lobe of the gloss.

    Attributes:
        vertex: index into the bounce's vertices, each at most once.
        light: the light gathered there, per unit of value, as a weighted sum of the environment's pixels.
        onward: the weight of the radiance that the path meets next, per unit of value.
    """

    vertex: Int[ndarray, " some"]
    light: Taps
    onward: Float[ndarray, " some"]


@dataclass(frozen=True, eq=False)
class Gloss:
    """A reflection whose value is `glossy.lobe` of these cosines."""

    cosines: Cosines
    reflection: Reflection


@dataclass(frozen=True, eq=False)
class Bounce:
    """The vertices of many paths at one depth: all that shading needs, and nothing that depends on values of maps.

    Attributes:
        path: which path each vertex belongs to, each at most once; a path that has left the scene has no vertex.
        part: index into the surface's parts.
        uv: texture coordinates.
        diffuse: at all vertices, from both directions; its value is the base colour.
        gloss: at glossy vertices, one from each direction.
    """

    path: Int[ndarray, " vertices"]
    part: Int[ndarray, " vertices"]
    uv: Float[ndarray, "vertices 2"]
    diffuse: Reflection
    gloss: tuple[Gloss, ...]

    @property
    def reflections(self) -> tuple[Reflection, ...]:
        """All the summands, the diffuse one first."""
        return (self.diffuse, *(gloss.reflection for gloss in self.gloss))


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
    """The values and lights of the bounce, with these maps under this environment."""
    values = [_lookup(bounce, maps["base_color"], bounce.diffuse).apply(maps["base_color"].texels)]
    for gloss in bounce.gloss:
        roughness = _lookup(bounce, maps["roughness"], gloss.reflection).apply(maps["roughness"].texels)[:, 0]
        values.append(lobe(gloss.cosines, _alpha(roughness))[:, None])
    return Shading(values, [reflection.light.apply(environment) for reflection in bounce.reflections])


def shade_vjp(
    bounce: Bounce, maps: Mapping[str, Texture], grad_values: Sequence[Values]
) -> Iterator[tuple[str, Taps, Values]]:
    """For each lookup of a map: its name, its taps and the gradient of its result, given those of `shade`'s values."""
    yield "base_color", _lookup(bounce, maps["base_color"], bounce.diffuse), grad_values[0]
    for gloss, grad in zip(bounce.gloss, grad_values[1:], strict=True):
        taps = _lookup(bounce, maps["roughness"], gloss.reflection)
        roughness = taps.apply(maps["roughness"].texels)[:, 0]
        slope = lobe_slope(gloss.cosines, _alpha(roughness)) * _alpha_slope(roughness)
        yield "roughness", taps, grad * slope[:, None]


def radiance(paths: int, bounces: Sequence[Bounce], shadings: Sequence[Shading]) -> Float[ndarray, "paths 3"]:
    """The radiance that each path brings to the camera, summed from its last vertex to its first."""
    leaving = np.zeros((paths, 3))
    for bounce, shading in zip(reversed(bounces), reversed(shadings), strict=True):
        arriving = _arriving(bounce, shading, leaving[bounce.path])
        leaving[bounce.path] = _leaving(bounce, shading.values, arriving)
    return leaving


def radiance_vjp(
    bounces: Sequence[Bounce], shadings: Sequence[Shading], grad: Float[ndarray, "paths 3"]
) -> tuple[list[list[Values]], list[list[Rgb]]]:
    """The gradients of sum(radiance * grad) with respect to the values and the lights of every bounce.

    With P_k the share of L_k that reaches the camera, the product of sum_j v_j t_j over the vertices before, the
    radiance is P_k v_j (e_j + t_j L_(k+1)) plus terms without v_j and e_j. P_k is multiplied up from the camera and
    kept for each vertex; dividing a path's radiance by its values instead would fail for black texels.
    """
    prefix, before = [], grad.copy()
    for bounce, shading in zip(bounces, shadings, strict=True):
        prefix.append(before[bounce.path])
        before[bounce.path] *= _leaving(bounce, shading.values, [r.onward[:, None] for r in bounce.reflections])
    grad_values, grad_lights, leaving = [], [], np.zeros_like(grad)
    for bounce, shading, p in zip(reversed(bounces), reversed(shadings), reversed(prefix), strict=True):
        arriving = _arriving(bounce, shading, leaving[bounce.path])
        leaving[bounce.path] = _leaving(bounce, shading.values, arriving)
        shares = [p[reflection.vertex] for reflection in bounce.reflections]
        grad_lights.append([share * value for share, value in zip(shares, shading.values, strict=True)])
        grads = [share * light for share, light in zip(shares, arriving, strict=True)]
        grad_values.append([grads[0], *(g.sum(axis=-1, keepdims=True) for g in grads[1:])])
    return grad_values[::-1], grad_lights[::-1]


def _lookup(bounce: Bounce, texture: Texture, reflection: Reflection) -> Taps:
    return texture.taps(bounce.part[reflection.vertex], bounce.uv[reflection.vertex])


def _alpha(roughness: Float[ndarray, " points"]) -> Float[ndarray, " points"]:
    return np.maximum(roughness, LEAST_ROUGHNESS) ** 2


def _alpha_slope(roughness: Float[ndarray, " points"]) -> Float[ndarray, " points"]:
    return np.where(roughness < LEAST_ROUGHNESS, 0.0, 2.0 * roughness)


def _arriving(bounce: Bounce, shading: Shading, next_leaving: Rgb) -> list[Rgb]:
    """e_j + t_j L_(k+1) of each reflection."""
    return [
        light + reflection.onward[:, None] * next_leaving[reflection.vertex]
        for reflection, light in zip(bounce.reflections, shading.lights, strict=True)
    ]


def _leaving(bounce: Bounce, values: Sequence[Values], arriving: Sequence[Values]) -> Rgb:
    """The sum over the reflections at each vertex."""
    total = np.zeros((len(bounce.path), 3))
    for reflection, value, light in zip(bounce.reflections, values, arriving, strict=True):
        total[reflection.vertex] += value * light
    return total
