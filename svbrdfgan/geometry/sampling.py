"""Deterministic low-discrepancy samples: points on triangles, and directions on the upper hemisphere."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import unit


def faces_by_area(total: Float[ndarray, " faces"], count: int) -> Int[ndarray, " points"]:
    """The face of each of `count` points, in ascending order. The number per face is proportional to its area.

    Args:
        total: cumulative sum of the faces' areas; the last must not be zero.
    """
    return np.searchsorted(total, (np.arange(count) + 0.5) * (total[-1] / count)).clip(max=len(total) - 1)


def points_in_triangle(index: Int[ndarray, " points"]) -> Float[ndarray, "points 3"]:
    """Barycentric coordinates of the R2 sequence's points (Roberts 2018) at these indices, folded into the triangle."""
    square = (0.5 + index[:, None] * np.array([0.7548776662466927, 0.5698402909980532])) % 1.0
    square = np.where(square.sum(axis=1, keepdims=True) > 1.0, 1.0 - square, square)
    return np.column_stack([1.0 - square.sum(axis=1), square])


def upper_frames(order: Int[ndarray, " directions"]) -> Float[ndarray, "directions 3 3"]:
    """Orthonormal frames as rows; the last rows are evenly spread over the upper hemisphere (Fibonacci lattice).

    Args:
        order: a permutation of the directions; 0 is nearest to the horizon, the greatest nearest to the zenith (+Y).
    """
    height = (order + 0.5) / len(order)
    turn = order * (np.pi * (3.0 - np.sqrt(5.0)))
    ring = np.sqrt(1.0 - height**2)
    axes = np.column_stack([ring * np.cos(turn), height, ring * np.sin(turn)])
    first = unit(np.cross(axes, np.roll(axes, 1, axis=1)))
    return np.stack([first, np.cross(axes, first), axes], axis=1)
