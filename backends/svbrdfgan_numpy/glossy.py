"""The gloss of glTF 2.0's dielectric, F D G / (4 |n . w_o| |n . w_i|), and directions drawn independently of roughness.

F is Schlick's term, D the GGX distribution and G its separable Smith term (Walter et al. 2007; glTF 2.0, appendix B).
Directions are drawn by a half vector of the GGX distribution whose alpha is drawn first, its logarithm uniform between
`SHARPEST` and 1. The density averaged over alpha still has a closed form. The mixture has an alpha close to every
roughness, and the paths do not depend on the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.types import DIELECTRIC_REFLECTANCE, LEAST_ROUGHNESS
from svbrdfgan_numpy.vectors import dot, from_frame, normalize

SHARPEST = LEAST_ROUGHNESS**2 / 2.0
"""The least alpha that is drawn. It is below the least in use, because the mixture is poor at its very end."""

PerPoint = Float[ndarray, " points"]


@dataclass(frozen=True, eq=False)
class Cosines:
    """The cosines of a pair of directions that determine the gloss; h is the unit vector halfway between them.

    Attributes:
        outgoing: n . w_o, not negative.
        incoming: n . w_i, 0 where the light comes from behind.
        half: n . h.
        difference: w_o . h, positive: the cosine of the difference angle.
    """

    outgoing: PerPoint
    incoming: PerPoint
    half: PerPoint
    difference: PerPoint


def cosines_between(
    normal: Float[ndarray, "points 3"], outgoing: Float[ndarray, "points 3"], incoming: Float[ndarray, "points 3"]
) -> Cosines:
    """The cosines of pairs of directions that point away from the surface. `normal` is turned to the viewer."""
    half = normalize(outgoing + incoming, fallback=normal)
    return Cosines(
        outgoing=np.maximum(dot(normal, outgoing), 0.0),
        incoming=np.maximum(dot(normal, incoming), 0.0),
        half=np.maximum(dot(normal, half), 0.0),
        difference=np.maximum(dot(outgoing, half), 1e-12),
    )


def fresnel(cosines: Cosines) -> PerPoint:
    """The share F of the light that the gloss reflects; the diffuse term gets the rest."""
    return DIELECTRIC_REFLECTANCE + (1.0 - DIELECTRIC_REFLECTANCE) * (1.0 - np.minimum(cosines.difference, 1.0)) ** 5


def lobe(cosines: Cosines, alpha: PerPoint) -> PerPoint:
    """The gloss times the cosine n . w_i, per unit of Fresnel reflectance: D G / (4 |n . w_o|)."""
    distribution = alpha**2 / (np.pi * _spread(cosines, alpha) ** 2)
    masking = cosines.outgoing + _root(cosines.outgoing, alpha)
    shadowing = cosines.incoming + _root(cosines.incoming, alpha)
    return distribution * cosines.incoming / (masking * shadowing)


def lobe_slope(cosines: Cosines, alpha: PerPoint) -> PerPoint:
    """The derivative of `lobe` with respect to alpha, from that of its logarithm."""
    slope = 2.0 / alpha - 4.0 * alpha * cosines.half**2 / _spread(cosines, alpha)
    for cosine in (cosines.outgoing, cosines.incoming):
        root = _root(cosine, alpha)
        slope = slope - alpha * (1.0 - cosine**2) / (root * (cosine + root))
    return lobe(cosines, alpha) * slope


def sample(
    normal: Float[ndarray, "points 3"], outgoing: Float[ndarray, "points 3"], random: Float[ndarray, "points 2"]
) -> Float[ndarray, "points 3"]:
    """Unit directions, some of them behind the surface: w_o reflected at half vectors.

    Their angle to the normal has P(tan^2 <= t) = log((t + m^2) / (m^2 (1 + t))) / (2 log(1 / m)), averaged over alpha,
    with m = `SHARPEST`. This inverts it.
    """
    sine2 = (SHARPEST ** (2.0 - 2.0 * random[:, 0]) - SHARPEST**2) / (1.0 - SHARPEST**2)
    half = from_frame(normal, np.clip(sine2, 0.0, 1.0), 2.0 * np.pi * random[:, 1])
    return 2.0 * dot(outgoing, half)[:, None] * half - outgoing


def pdf(cosines: Cosines) -> PerPoint:
    """The density of `sample`, per steradian; 0 behind the surface, where light is ignored."""
    sine2 = 1.0 - cosines.half**2
    spread = SHARPEST**2 + (1.0 - SHARPEST**2) * sine2
    of_half = (1.0 - SHARPEST**2) * cosines.half / (2.0 * np.pi * math.log(1.0 / SHARPEST) * spread)
    return np.where(cosines.incoming > 0.0, of_half / (4.0 * cosines.difference), 0.0)


def _spread(cosines: Cosines, alpha: PerPoint) -> PerPoint:
    """alpha^2 cos^2 + sin^2 of the half vector."""
    return (alpha * cosines.half) ** 2 + (1.0 - cosines.half**2)


def _root(cosine: PerPoint, alpha: PerPoint) -> PerPoint:
    """The root in Smith's G1 = 2 cos / (cos + root)."""
    return np.sqrt(alpha**2 + (1.0 - alpha**2) * cosine**2)
