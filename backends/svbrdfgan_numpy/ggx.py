"""The facets of a rough surface: Trowbridge and Reitz's distribution, called GGX, and Smith's masking of it.

All functions take cosines to the normal and alpha squared; slopes are those of the functions' logarithms. Equations
are of Walter et al. 2007. Directions are drawn by the facets that the viewer sees (Heitz 2018), as Dupuy and Benyoub
2023 ("Sampling Visible GGX Normals with Spherical Caps") draw them.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan_numpy.vectors import dot, normalize, tangents

PerPoint = Float[ndarray, " points"]


def distribution(half: PerPoint, alpha2: PerPoint) -> PerPoint:
    """The density D of facets whose normals are at this cosine, per steradian and area of the surface."""
    return alpha2 / (np.pi * _spread(half, alpha2) ** 2)


def distribution_slopes(half: PerPoint, alpha2: PerPoint) -> tuple[PerPoint, PerPoint]:
    """The slopes of log D in the cosine and in alpha squared."""
    spread = _spread(half, alpha2)
    return 4.0 * (1.0 - alpha2) * half / spread, 1.0 / alpha2 - 2.0 * half**2 / spread


def masking(cosine: PerPoint, alpha2: PerPoint) -> PerPoint:
    """Smith's G1 over the cosine: 2 / (cosine + sqrt(alpha^2 + (1 - alpha^2) cosine^2)), finite at the horizon."""
    return 2.0 / (cosine + _root(cosine, alpha2))


def masking_slopes(cosine: PerPoint, alpha2: PerPoint) -> tuple[PerPoint, PerPoint]:
    """The slopes of the logarithm of `masking` in the cosine and in alpha squared."""
    root = _root(cosine, alpha2)
    both = root * (cosine + root)
    return -(root + (1.0 - alpha2) * cosine) / both, -0.5 * (1.0 - cosine**2) / both


def sample(
    normal: Float[ndarray, "points 3"],
    outgoing: Float[ndarray, "points 3"],
    alpha2: PerPoint,
    random: Float[ndarray, "points 2"],
) -> Float[ndarray, "points 3"]:
    """Unit directions, some of them below the surface: `outgoing` mirrored by visible facets. n . w_o >= 0.

    Stretching the surface by 1 / alpha makes the facets a hemisphere, whose mirror images fill a cap evenly.
    """
    across, along, stretch = *tangents(normal), np.stack([np.sqrt(alpha2)] * 2 + [np.ones_like(alpha2)], axis=-1)
    local = np.stack([dot(across, outgoing), dot(along, outgoing), np.maximum(dot(normal, outgoing), 0.0)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    viewer = normalize(stretch * local, fallback=up)
    height = (1.0 - random[:, 1]) * (1.0 + viewer[:, 2]) - viewer[:, 2]
    radius, azimuth = np.sqrt(np.maximum(1.0 - height**2, 0.0)), 2.0 * np.pi * random[:, 0]
    half = viewer + np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=-1)
    x, y, z = normalize(stretch * half, fallback=up).T
    facet = x[:, None] * across + y[:, None] * along + z[:, None] * normal
    return 2.0 * dot(outgoing, facet)[:, None] * facet - outgoing


def pdf(outgoing: PerPoint, half: PerPoint, alpha2: PerPoint) -> PerPoint:
    """The density of `sample`, per steradian: D G1(w_o) / (4 n . w_o)."""
    return 0.25 * distribution(half, alpha2) * masking(outgoing, alpha2)


def _spread(half: PerPoint, alpha2: PerPoint) -> PerPoint:
    """alpha^2 cos^2 + sin^2 of the half vector."""
    return alpha2 * half**2 + (1.0 - half**2)


def _root(cosine: PerPoint, alpha2: PerPoint) -> PerPoint:
    return np.sqrt(alpha2 + (1.0 - alpha2) * cosine**2)
