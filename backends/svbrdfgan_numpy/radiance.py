"""What paths carry, given materials and light; and, by the product rule, what depends on each.

With v_j the values of the reflections at vertex k, e_j the light that they gather and t_j their weights of what the
path goes on to, the radiance that leaves the vertex is L_k = sum_j v_j (e_j + t_j L_(k+1)). The camera sees L_0.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan_numpy.bounce import Bounce
from svbrdfgan_numpy.shading import Rgb, Shading, Values


def radiance(paths: int, bounces: Sequence[Bounce], shadings: Sequence[Shading]) -> Float[ndarray, "paths 3"]:
    """The radiance that each path brings to the camera, from its last vertex to its first."""
    leaving = np.zeros((paths, 3))
    for bounce, shading in zip(reversed(bounces), reversed(shadings), strict=True):
        arriving = _arriving(bounce, shading, leaving[bounce.path])
        leaving[bounce.path] = _leaving(bounce, shading.values, arriving)
    return leaving


def radiance_vjp(
    bounces: Sequence[Bounce], shadings: Sequence[Shading], grad: Float[ndarray, "paths 3"]
) -> tuple[list[list[Values]], list[list[Rgb]]]:
    """The gradients of sum(radiance * grad) in the values and in the lights of every bounce.

    With P_k the share of L_k that reaches the camera, the product of sum_j v_j t_j over the vertices before, the
    radiance is P_k v_j (e_j + t_j L_(k+1)) plus what depends neither on v_j nor on e_j.
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
