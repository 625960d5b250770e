"""The radiance that paths carry, from their vertices, the maps and the light; and its gradient.

From each vertex a path looks in two directions. With v_j what the vertex reflects from direction j (the BSDF times the
cosine), e_j the light that it gathers there, and t_j the weight of what the path meets next, the radiance that leaves
the vertex is L_k = sum_j v_j (e_j + t_j L_(k+1)). The camera sees L_0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan_numpy.bsdf import Bsdf
from svbrdfgan_numpy.materials import MaterialPoints
from svbrdfgan_numpy.textures import Taps, Texture

Rgb = Float[ndarray, "_ 3"]


@dataclass(frozen=True, eq=False)
class Arrival:
    """The light that arrives at some vertices, from one direction for each of them.

    Attributes:
        direction: unit, away from the surface.
        light: the light gathered there, per unit of what is reflected, as a weighted sum of the environment's pixels.
        onward: the weight of the radiance that the path meets next, per unit of what is reflected.
    """

    direction: Float[ndarray, "vertices 3"]
    light: Taps
    onward: Float[ndarray, " vertices"]


@dataclass(frozen=True, eq=False)
class Bounce:
    """The vertices of many paths at one depth: all that shading needs but the maps and the light.

    Attributes:
        path: which path each vertex belongs to, each at most once; a path that has left the scene has no vertex.
        vertices: where they are.
        arrivals: from each of the two directions.
    """

    path: Int[ndarray, " vertices"]
    vertices: MaterialPoints
    arrivals: tuple[Arrival, Arrival]


@dataclass(frozen=True, eq=False)
class Shading:
    """A bounce with materials and light.

    Attributes:
        bsdf: of its vertices.
        reflected: the share reflected from each direction.
        lights: gathered from each direction.
    """

    bsdf: Bsdf
    reflected: Sequence[Rgb]
    lights: Sequence[Rgb]


def shade(bounce: Bounce, maps: Mapping[str, Texture], environment: Float[ndarray, "pixels 3"]) -> Shading:
    """The bounce with these maps under this environment: what it reflects and gathers."""
    bsdf, outgoing = bounce.vertices.bsdf(maps), bounce.vertices.points.outgoing
    reflected = [bsdf.evaluate(outgoing, arrival.direction) for arrival in bounce.arrivals]
    return Shading(bsdf, reflected, [arrival.light.apply(environment) for arrival in bounce.arrivals])


def shade_vjp(
    bounce: Bounce, shading: Shading, maps: Mapping[str, Texture], grad_reflected: Sequence[Rgb]
) -> Iterator[tuple[str, Taps, Float[ndarray, "_ channels"]]]:
    """Each map's name and taps, and the gradient of what the taps gave, from that of what is reflected."""
    outgoing = bounce.vertices.points.outgoing
    first, second = (
        shading.bsdf.evaluate_vjp(outgoing, arrival.direction, grad)
        for arrival, grad in zip(bounce.arrivals, grad_reflected, strict=True)
    )
    return bounce.vertices.bsdf_vjp(maps, first + second)


def radiance(paths: int, bounces: Sequence[Bounce], shadings: Sequence[Shading]) -> Float[ndarray, "paths 3"]:
    """The radiance that each path brings to the camera, summed from its last vertex to its first."""
    leaving = np.zeros((paths, 3))
    for bounce, shading in zip(reversed(bounces), reversed(shadings), strict=True):
        leaving[bounce.path] = _leaving(shading, _arriving(bounce, shading, leaving))
    return leaving


def radiance_vjp(
    bounces: Sequence[Bounce], shadings: Sequence[Shading], grad: Float[ndarray, "paths 3"]
) -> tuple[list[list[Rgb]], list[list[Rgb]]]:
    """The gradients of sum(radiance * grad) with respect to what every bounce reflects and gathers.

    With P_k the share of L_k that reaches the camera, the product of sum_j v_j t_j over the vertices before, the
    radiance is P_k v_j (e_j + t_j L_(k+1)) plus terms without v_j and e_j. P_k is multiplied up from the camera and
    kept for each vertex; dividing a path's radiance by its factors instead would fail for black texels.
    """
    prefix, before = [], grad.copy()
    for bounce, shading in zip(bounces, shadings, strict=True):
        prefix.append(before[bounce.path])
        before[bounce.path] *= _leaving(shading, [arrival.onward[:, None] for arrival in bounce.arrivals])
    grad_reflected, grad_lights, leaving = [], [], np.zeros_like(grad)
    for bounce, shading, share in zip(reversed(bounces), reversed(shadings), reversed(prefix), strict=True):
        arriving = _arriving(bounce, shading, leaving)
        leaving[bounce.path] = _leaving(shading, arriving)
        grad_lights.append([share * reflected for reflected in shading.reflected])
        grad_reflected.append([share * light for light in arriving])
    return grad_reflected[::-1], grad_lights[::-1]


def _arriving(bounce: Bounce, shading: Shading, next_leaving: Rgb) -> list[Rgb]:
    """e_j + t_j L_(k+1) from each direction."""
    following = next_leaving[bounce.path]
    return [
        light + arrival.onward[:, None] * following
        for arrival, light in zip(bounce.arrivals, shading.lights, strict=True)
    ]


def _leaving(shading: Shading, arriving: Sequence[Float[ndarray, "vertices _"]]) -> Rgb:
    """The sum over both directions at each vertex."""
    first, second = (reflected * light for reflected, light in zip(shading.reflected, arriving, strict=True))
    return first + second
