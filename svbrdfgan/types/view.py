"""The camera, the light and the film of a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Camera:
    """A pinhole camera that looks from `origin` to `target`.

    Attributes:
        origin, target: points in metres.
        up: any direction that is not parallel to the line of sight.
        vertical_fov: full angle between the bottom and the top of the image, radians in (0, pi).

    Raises:
        ConfigError: the line of sight has no length or is parallel to `up`, or the angle is out of range.
    """

    origin: Vector
    target: Vector = (0.0, 0.0, 0.0)
    up: Vector = (0.0, 1.0, 0.0)
    vertical_fov: float = math.radians(40.0)

    def __post_init__(self) -> None:
        sight = np.subtract(self.target, self.origin)
        if not np.isfinite([*self.origin, *self.target, *self.up]).all():
            raise ConfigError("camera origin, target and up must be finite.")
        if np.linalg.norm(_cross(sight, self.up)) < 1e-12 * max(1.0, float(np.linalg.norm(sight))):
            raise ConfigError(f"camera at {self.origin} looking to {self.target} with up {self.up} has no orientation.")
        if not 0.0 < self.vertical_fov < math.pi:
            raise ConfigError(f"camera vertical_fov is {self.vertical_fov}; wanted radians between 0 and pi.")

    @classmethod
    def orbit(cls, azimuth: float, elevation: float, distance: float, target: Vector, vertical_fov: float) -> Camera:
        """A camera on a sphere about `target`: azimuth 0 is in front (+Z), pi/2 at the world's right (+X).

        Angles in radians, distance in metres.
        """
        direction = (
            math.cos(elevation) * math.sin(azimuth),
            math.sin(elevation),
            math.cos(elevation) * math.cos(azimuth),
        )
        x, y, z = (t + distance * d for t, d in zip(target, direction, strict=True))
        return cls((x, y, z), target, vertical_fov=vertical_fov)

    def basis(self) -> Float[ndarray, "3 3"]:
        """Rows: unit vectors to the right of the image, to its top, and backward (the camera looks down its -Z)."""
        backward = np.subtract(self.origin, self.target)
        backward = backward / np.linalg.norm(backward)
        right = _cross(self.up, backward)
        right = right / np.linalg.norm(right)
        return np.stack([right, _cross(backward, right), backward])


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from infinitely far away, as an equirectangular image.

    Attributes:
        radiance: linear, not negative. Row 0 is at the zenith (+Y), the middle column at -Z, +X a quarter to its right.
        rotation: turns the light about +Y, counter-clockwise seen from above, radians.

    Raises:
        AssetError: the image is not (rows, cols, 3).
    """

    radiance: Float[Tensor, "rows cols 3"]
    rotation: float = 0.0

    def __post_init__(self) -> None:
        if self.radiance.ndim != 3 or self.radiance.shape[-1] != 3 or self.radiance.numel() == 0:
            raise AssetError(f"environment has shape {tuple(self.radiance.shape)}; wanted (rows, cols, 3).")


@dataclass(frozen=True, eq=False)
class View:
    """The camera, the light and the film size (pixels) of a picture."""

    camera: Camera
    environment: Environment
    width: int
    height: int

    def __post_init__(self) -> None:
        if self.width < 1 or self.height < 1:
            raise ConfigError(f"film is {self.width} x {self.height} pixels; wanted at least 1 x 1.")


def _cross(a: Sequence[float] | Float[ndarray, 3], b: Sequence[float] | Float[ndarray, 3]) -> Float[ndarray, 3]:
    """`np.cross` of two vectors, in a tenth of its time: renderers ask for a camera's basis with each picture."""
    ax, ay, az = map(float, a)
    bx, by, bz = map(float, b)
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
