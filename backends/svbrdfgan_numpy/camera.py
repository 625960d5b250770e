"""Camera rays."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.types import View


def camera_rays(
    view: View, pixel: Int[ndarray, " rays"], random: Float[ndarray, "rays 2"]
) -> tuple[Float[ndarray, "rays 3"], Float[ndarray, "rays 3"]]:
    """Origins and unit directions of rays through pixels (row * width + column), `random` saying where in each."""
    row, col = np.divmod(pixel, view.width)
    extent = math.tan(view.camera.vertical_fov / 2.0)
    x = (2.0 * (col + random[:, 0]) - view.width) / view.height * extent
    y = (1.0 - 2.0 * (row + random[:, 1]) / view.height) * extent
    direction = np.stack([x, y, np.full_like(x, -1.0)], axis=-1) @ view.camera.basis()
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.broadcast_to(np.asarray(view.camera.origin, dtype=np.float64), direction.shape), direction
