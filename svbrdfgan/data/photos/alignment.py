"""Similarity transforms from the axes in which cameras were reconstructed to those of the data set."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from pydantic import Field, model_validator

from svbrdfgan.config.models import StrictModel
from svbrdfgan.types.view import Vector

Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]
"""Rows of a 4 x 4 matrix."""

_TOLERANCE = 1e-3


def similarity(matrix: Float[ndarray, "4 4"]) -> tuple[float, Float[ndarray, "3 3"], Float[ndarray, " 3"]]:
    """The scale, rotation and translation that a matrix consists of.

    Raises:
        ValueError: it does anything else, such as mirroring or stretching.
    """
    linear = matrix[:3, :3]
    scale = float(np.cbrt(np.linalg.det(linear)))
    rotation = linear / scale if scale > 0 else np.zeros((3, 3))
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _TOLERANCE or (matrix[3] != (0, 0, 0, 1)).any():
        raise ValueError("wanted a 4 x 4 matrix of rotation, uniform scale and translation, with last row 0, 0, 0, 1")
    return scale, rotation, matrix[:3, 3]


class Alignment(StrictModel):
    """The similarity transform from a capture's axes to those of the data set: Y up, nose at +Z, metres."""

    up: Vector = Field(default=(0.0, 1.0, 0.0), description="the direction upwards, in the capture's axes")
    nose: Vector = Field(
        default=(0.0, 0.0, 1.0), description="that to which the nose points; its part along `up` is ignored"
    )
    scale: float = Field(default=1.0, gt=0, description="metres in one of the capture's units")
    matrix: Matrix | None = Field(
        default=None, description="4 x 4, by rows, instead of the other keys: it maps columns (x, y, z, 1)"
    )

    @model_validator(mode="after")
    def _is_similarity(self) -> Alignment:
        if self.matrix is not None:
            if self.model_fields_set != {"matrix"}:
                raise ValueError("'matrix' stands instead of 'up', 'nose' and 'scale'; give one or the others")
            similarity(np.asarray(self.matrix))
        elif np.linalg.norm(np.cross(self.up, self.nose)) < 1e-6 * np.linalg.norm(self.up) * np.linalg.norm(self.nose):
            raise ValueError("'nose' is parallel to 'up'; give a direction to the side of it")
        elif not (np.any(self.up) and np.any(self.nose)):
            raise ValueError("'up' and 'nose' must be directions, not zero")
        return self

    def array(self) -> Float[ndarray, "4 4"]:
        """The matrix that maps points of the capture, as columns (x, y, z, 1), to the data set's."""
        if self.matrix is not None:
            return np.asarray(self.matrix)
        right = np.cross(self.up, self.nose)
        rows = [axis / np.linalg.norm(axis) for axis in (right, np.asarray(self.up), np.cross(right, self.up))]
        made = np.eye(4)
        made[:3, :3] = self.scale * np.stack(rows)
        return made

    def apply(self, points: Float[ndarray, "points 3"]) -> Float[ndarray, "points 3"]:
        """Points of the capture in the data set's axes, metres."""
        matrix = self.array()
        return points @ matrix[:3, :3].T + matrix[:3, 3]
