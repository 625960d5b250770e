"""Small vector algebra on arrays of 3-vectors, shape (..., 3)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

Vectors = Float[ndarray, "*shape 3"]


def dot(a: Vectors, b: Vectors) -> Float[ndarray, "*shape"]:
    """The scalar product of each pair."""
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def cross(a: Vectors, b: Vectors) -> Vectors:
    """The vector product of each pair, right-handed."""
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)


def normalize(a: Vectors, fallback: Vectors) -> Vectors:
    """Each vector scaled to unit length; `fallback` for zero vectors."""
    length = np.sqrt(dot(a, a))[..., None]
    return np.where(length > 0.0, a / np.where(length > 0.0, length, 1.0), fallback)


def tangents(normal: Float[ndarray, "points 3"]) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"]]:
    """Two unit vectors that make a right-handed frame with each unit normal (Duff et al. 2017, listing 3)."""
    x, y, z = normal.T
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    tangent = np.stack([1.0 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return tangent, np.stack([b, sign + y * y * a, -y], axis=-1)


def from_frame(
    normal: Float[ndarray, "points 3"], sine2: Float[ndarray, " points"], azimuth: Float[ndarray, " points"]
) -> Float[ndarray, "points 3"]:
    """Unit vectors at an angle to the normal, given by the square of its sine, and at an azimuth about it."""
    radius = np.sqrt(sine2)
    x, y, z = radius * np.cos(azimuth), radius * np.sin(azimuth), np.sqrt(1.0 - sine2)
    tangent, bitangent = tangents(normal)
    return x[:, None] * tangent + y[:, None] * bitangent + z[:, None] * normal
