"""Tests whether a closed polygon in the plane crosses itself."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray


def loop_crosses_itself(points: Float[ndarray, "loop 2"]) -> bool:
    """Whether two segments of the closed polygon that are not neighbours have a point in common."""
    count = len(points)
    one, other = close_pairs(points)
    apart = (one - other) % count
    chosen = (apart > 1) & (apart < count - 1)
    a, b = points[one[chosen]], points[(one[chosen] + 1) % count]
    c, d = points[other[chosen]], points[(other[chosen] + 1) % count]
    return bool(((_side(a, b, c) * _side(a, b, d) <= 0) & (_side(c, d, a) * _side(c, d, b) <= 0)).any())


def close_pairs(
    points: Float[ndarray, "loop 2"], gap: float = 0.0
) -> tuple[Int[ndarray, " pairs"], Int[ndarray, " pairs"]]:
    """Pairs of segments whose bounding boxes, grown by half a gap, overlap; found by a sweep along the first axis."""
    ends = np.stack([points, np.roll(points, -1, axis=0)])
    low, high = ends.min(axis=0) - gap / 2, ends.max(axis=0) + gap / 2
    order = np.argsort(low[:, 0], kind="stable")
    low, high = low[order], high[order]
    last = np.searchsorted(low[:, 0], high[:, 0], side="right")
    count = last - np.arange(len(points)) - 1
    one = np.repeat(np.arange(len(points)), count)
    other = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count)
    meet = (low[one, 1] <= high[other, 1]) & (low[other, 1] <= high[one, 1])
    return order[one[meet]], order[other[meet]]


def _side(a: Float[ndarray, "n 2"], b: Float[ndarray, "n 2"], point: Float[ndarray, "n 2"]) -> Float[ndarray, " n"]:
    """Positive where the point lies to the left of the line from a to b."""
    along, to = b - a, point - a
    return along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0]
