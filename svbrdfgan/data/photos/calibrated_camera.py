"""A camera as calibration finds it: at any angle, with a principal point anywhere, and with a lens that distorts."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from pydantic import Field, model_validator
from scipy.optimize import root

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.photos.alignment import Alignment, Matrix, similarity
from svbrdfgan.errors import ConfigError
from svbrdfgan.types import Camera

Pixels = Annotated[float, Field(gt=0)]

_BORDER = np.array([(x, y) for y in (-1.0, 0.0, 1.0) for x in (-1.0, 0.0, 1.0)])
"""The picture's middle, corners and middles of its sides, in film coordinates."""
_MIDDLE = 4


class CalibratedCamera(StrictModel):
    """A camera by its pose, in metres of the mesh, and the pinhole and lens of OpenCV's model, in pixels."""

    camera_to_world: Matrix = Field(
        description="4 x 4, by rows; its columns are the directions to the right of the picture, to its top and "
        "backward, and the camera's position"
    )
    size: tuple[Pixels, Pixels] = Field(
        description="width and height of the picture that the pixels below are of; copies of another size are allowed"
    )
    focal: tuple[Pixels, Pixels] = Field(description="focal lengths in x and y, pixels")
    center: tuple[float, float] = Field(
        description="the principal point: pixels to the right of and below the picture's upper left corner"
    )
    distortion: tuple[float, float, float, float] = Field(
        default=(0.0, 0.0, 0.0, 0.0), description="OpenCV's k1, k2, p1 and p2"
    )

    @model_validator(mode="after")
    def _is_pose(self) -> CalibratedCamera:
        try:
            scale, _, _ = similarity(np.asarray(self.camera_to_world))
        except ValueError as error:
            raise ValueError(f"camera_to_world: {error}") from error
        if abs(scale - 1) > 1e-3:
            raise ValueError(f"camera_to_world: it scales by {scale:.4g}; wanted a rotation and a position alone")
        return self

    @classmethod
    def of(cls, camera: Camera, size: tuple[int, int]) -> CalibratedCamera:
        """A camera without distortion whose axis meets the middle of its picture of this width and height."""
        focal = size[1] / 2 / math.tan(camera.vertical_fov / 2)
        pose = _pose(camera.basis(), np.asarray(camera.origin))
        return cls(camera_to_world=pose, size=size, focal=(focal, focal), center=(size[0] / 2, size[1] / 2))

    @property
    def position(self) -> tuple[float, float, float]:
        x, y, z = (row[3] for row in self.camera_to_world[:3])
        return x, y, z

    def basis(self) -> Float[ndarray, "3 3"]:
        """Rows: unit vectors to the right of the image, to its top, and backward."""
        return similarity(np.asarray(self.camera_to_world))[1].T

    def aligned(self, alignment: Alignment) -> CalibratedCamera:
        """The camera in the data set's axes, if it is in the capture's."""
        _, turn, _ = similarity(alignment.array())
        position = alignment.apply(np.asarray(self.position)[None])[0]
        return self.model_copy(update={"camera_to_world": _pose(self.basis() @ turn.T, position)})

    def project(self, seen: Float[ndarray, "*shape 3"]) -> Float[ndarray, "*shape 2"]:
        """Points in the camera's axes in film coordinates, x to the right, y up, [-1, 1] inside the picture.

        NaN for points that are not in front of the camera, or so far from its axis that the distortion, which is fitted
        to the picture alone, would fold them back.
        """
        x, y = np.moveaxis(seen[..., :2] / np.where(seen[..., 2:] < 0, -seen[..., 2:], np.nan), -1, 0)
        k1, k2, p1, p2 = self.distortion
        square = x * x + y * y
        radial = np.where(square < self._fold(), 1 + square * (k1 + square * k2), np.nan)
        # OpenCV's y points down, so that p1 has the other sign
        bent_x = x * radial - 2 * p1 * x * y + p2 * (square + 2 * x * x)
        bent_y = y * radial - p1 * (square + 2 * y * y) + 2 * p2 * x * y
        (width, height), (focal_x, focal_y), (x0, y0) = self.size, self.focal, self.center
        return np.stack([2 * (x0 + focal_x * bent_x) / width - 1, 1 - 2 * (y0 - focal_y * bent_y) / height], axis=-1)

    def film_coordinates(
        self, points: Float[ndarray, "points 3"]
    ) -> tuple[Float[ndarray, "points 2"], Float[ndarray, " points"]]:
        """Points of the world in film coordinates, as `project` gives them, and their depths in metres.

        Raises:
            ConfigError: a point is not in front of the camera.
        """
        seen = (points - np.asarray(self.position)) @ self.basis().T
        depth = -seen[:, 2]
        if depth.min() <= 1e-6 * np.abs(seen).max():
            raise ConfigError(
                "the camera does not have all of the mesh in front of it: it stands inside, beside or with its back to "
                "it."
            )
        return self.project(seen), depth

    def ray(self, film: Float[ndarray, " 2"]) -> Float[ndarray, " 3"]:
        """The direction, of any length, that the camera sees at these film coordinates.

        Raises:
            ConfigError: there is none, because the distortion folds the picture there.
        """

        def error(tangents: Float[ndarray, " 2"]) -> Float[ndarray, " 2"]:
            return np.nan_to_num(self.project(np.array([*tangents, -1.0])) - film, nan=1e3)

        x, y = (film * (1, -1) + 1) / 2 * self.size - self.center
        start = np.array([x / self.focal[0], -y / self.focal[1]])
        bound = 0.99 * math.sqrt(self._fold())
        found = root(error, start * min(1.0, bound / max(float(np.hypot(*start)), 1e-12)))
        if np.abs(error(found.x)).max() > 1e-6:
            raise ConfigError(
                f"the distortion {self.distortion} folds the picture over itself; calibrate the camera again, or "
                "undistort its pictures."
            )
        return np.array([*found.x, -1.0]) @ self.basis()

    def pinhole(self) -> Camera:
        """The camera without distortion at the same place that has this one's middle in its own and sees all of it."""
        rays = np.stack([self.ray(film) for film in _BORDER])
        position = np.asarray(self.position)
        x, y, z = position + rays[_MIDDLE] / np.linalg.norm(rays[_MIDDLE])
        up_x, up_y, up_z = self.basis()[1]
        centred = Camera(self.position, (x, y, z), (up_x, up_y, up_z))
        seen = rays @ centred.basis().T
        tangents = np.abs(seen[:, :2] / seen[:, 2:]) / (self.size[0] / self.size[1], 1.0)
        return replace(centred, vertical_fov=2 * math.atan(float(tangents.max())))

    def _fold(self) -> float:
        """The square of the tangent at which the radial distortion stops growing; infinite if it never does."""
        k1, k2, _, _ = self.distortion
        turns = np.roots([5 * k2, 3 * k1, 1])
        return min((float(t.real) for t in turns if abs(t.imag) < 1e-12 and t.real > 0), default=math.inf)


def _pose(basis: Float[ndarray, "3 3"], position: Float[ndarray, " 3"]) -> Matrix:
    (a, b, c), (x, y, z) = basis.T.tolist(), position.tolist()
    return (*a, x), (*b, y), (*c, z), (0.0, 0.0, 0.0, 1.0)
