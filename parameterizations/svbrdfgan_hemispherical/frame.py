"""The model's own frame and equation 4.1 in it: points to (u, v) and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.errors import EmbeddingError

AXES: dict[str, Float[ndarray, "3 3"]] = {
    "z": np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "x": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
}
"""Per nose axis, rows: the vehicle's right (looking forward), up, and nose."""


@dataclass(frozen=True, eq=False)
class Frame:
    """Where the angles are taken.

    Attributes:
        centre: in metres, in the mesh's coordinates; below the ground.
        axes: rows right, up and nose; unit vectors.
    """

    centre: Float[ndarray, " 3"]
    axes: Float[ndarray, "3 3"]

    @classmethod
    def of_bounds(cls, bounds: Float[ndarray, "2 3"], axis: str, centre_height: float) -> Frame:
        """The frame of a model with these bounds.

        Raises:
            EmbeddingError: the model is flat.
        """
        size = bounds[1] - bounds[0]
        if size.min() <= 1e-6 * size.max():
            shown = " x ".join(f"{s:.3g}" for s in size)
            raise EmbeddingError(
                f"the mesh is flat ({shown} m); a hemispherical embedding needs width, height and length."
            )
        if axis == "auto":
            axis = "x" if size[0] > size[2] else "z"
        centre = bounds.mean(axis=0)
        centre[1] = bounds[0, 1] + centre_height * size[1]
        return cls(centre, AXES[axis])

    def uv(self, points: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 2"]:
        """Equation 4.1 of the thesis: (theta, phi) / pi."""
        right, up, nose = np.moveaxis((points - self.centre) @ self.axes.T, -1, 0)
        theta = np.arctan2(up, right)
        phi = np.arctan2(np.hypot(right, up), nose)
        return np.stack([theta, phi], axis=-1) / np.pi

    def elevation(self, points: Float[ndarray, "*n 3"]) -> Float[ndarray, " *n"]:
        """Distance from the centre in metres: along one direction, further is further out."""
        return np.linalg.norm(points - self.centre, axis=-1)
