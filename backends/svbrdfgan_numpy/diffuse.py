"""The Lambertian BSDF, per unit of base colour.

Directions point away from the surface; `normal` is the shading normal, turned to the viewer.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan_numpy.vectors import dot, from_frame


def evaluate(normal: Float[ndarray, "points 3"], incoming: Float[ndarray, "points 3"]) -> Float[ndarray, " points"]:
    """The BSDF times the cosine, per unit of base colour: max(n . w_i, 0) / pi."""
    return np.maximum(dot(normal, incoming), 0.0) / np.pi


def pdf(normal: Float[ndarray, "points 3"], incoming: Float[ndarray, "points 3"]) -> Float[ndarray, " points"]:
    """The density of `sample`, per steradian. It equals `evaluate`, so a path goes on weighted by base colour alone."""
    return evaluate(normal, incoming)


def sample(normal: Float[ndarray, "points 3"], random: Float[ndarray, "points 2"]) -> Float[ndarray, "points 3"]:
    """Unit directions, distributed as the cosine to the normal."""
    return from_frame(normal, random[:, 0], 2.0 * np.pi * random[:, 1])
