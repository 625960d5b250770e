"""What paths carry, given materials and light; and, by the product rule, what depends on each.

The radiance of a path is a_0 (e_0 + a_1 (e_1 + ...)): `a` the base colour and `e` the light gathered at its vertices.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan_numpy.integrator import Bounce
from svbrdfgan_numpy.texture import Texture

Rgb = Float[ndarray, "_ 3"]


def shade(
    bounces: Sequence[Bounce], texture: Texture, environment: Float[ndarray, "pixels 3"]
) -> tuple[list[Rgb], list[Rgb]]:
    """The base colour at every vertex, and the light gathered there per unit of it."""
    albedo = [texture.taps(bounce.part, bounce.uv).apply(texture.texels) for bounce in bounces]
    return albedo, [bounce.light.apply(environment) for bounce in bounces]


def radiance(
    paths: int, bounces: Sequence[Bounce], albedo: Sequence[Rgb], light: Sequence[Rgb]
) -> Float[ndarray, "paths 3"]:
    """The radiance that each path brings to the camera, from its last vertex to its first."""
    leaving = np.zeros((paths, 3))
    for bounce, a, e in zip(reversed(bounces), reversed(albedo), reversed(light), strict=True):
        leaving[bounce.path] = a * (e + leaving[bounce.path])
    return leaving


def radiance_vjp(
    bounces: Sequence[Bounce], albedo: Sequence[Rgb], light: Sequence[Rgb], grad: Float[ndarray, "paths 3"]
) -> tuple[list[Rgb], list[Rgb]]:
    """The gradients of sum(radiance * grad) in `albedo` and in `light`, at every vertex.

    With P_k = a_0 ... a_(k-1) what reaches the camera of the light that leaves x_k, and S_k = e_k + a_(k+1) S_(k+1)
    all the light that arrives there, the radiance is P_k a_k S_k plus what does not depend on a_k.
    """
    prefix, grad_light, before = [], [], grad.copy()
    for bounce, a in zip(bounces, albedo, strict=True):
        prefix.append(before[bounce.path])
        before[bounce.path] *= a
        grad_light.append(before[bounce.path])
    grad_albedo, leaving = [], np.zeros_like(grad)
    for bounce, p, a, e in zip(reversed(bounces), reversed(prefix), reversed(albedo), reversed(light), strict=True):
        arriving = e + leaving[bounce.path]
        grad_albedo.append(p * arriving)
        leaving[bounce.path] = a * arriving
    return grad_albedo[::-1], grad_light
