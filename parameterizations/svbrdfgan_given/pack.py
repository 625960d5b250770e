"""Boxes side by side in the unit square, on shelves, as large as fits."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

_HALVINGS = 40


def pack(
    sizes: Float[ndarray, "boxes 2"], fixed: Float[ndarray, "boxes 2"], gutter: float
) -> tuple[float, Float[ndarray, "boxes 2"]] | None:
    """A common scale for the sizes, and each box's lower left corner; None if no scale fits.

    `fixed` is added to the scaled sizes. Boxes lie `gutter` apart, and half of that from the border.
    """
    order = np.lexsort((-sizes[:, 0], -(sizes[:, 1] + fixed[:, 1])))
    area = float(sizes.prod(axis=1).sum())
    low, high = 0.0, 2.0 / max(area, float(sizes.max()) ** 2, 1e-300) ** 0.5
    best = _shelves(fixed + low * sizes, order, gutter)
    for _ in range(_HALVINGS):
        if best is None:
            break
        middle = (low + high) / 2.0
        found = _shelves(fixed + middle * sizes, order, gutter)
        if found is None:
            high = middle
        else:
            low, best = middle, found
    return None if best is None else (low, best)


def _shelves(sizes: Float[ndarray, "boxes 2"], order: ndarray, gutter: float) -> Float[ndarray, "boxes 2"] | None:
    """Lower left corners, rows filled from left to right and stacked upwards; None if they do not fit."""
    corners = np.empty_like(sizes)
    border = 1.0 - gutter / 2.0
    left = bottom = gutter / 2.0
    top = bottom
    for box in order.tolist():
        width, height = sizes[box]
        if left + width > border:
            left, bottom = gutter / 2.0, top + gutter
        if left + width > border or bottom + height > border:
            return None
        corners[box] = left, bottom
        left += width + gutter
        top = max(top, bottom + height)
    return corners
