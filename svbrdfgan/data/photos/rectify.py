"""Warps a picture to the data set's camera, which stands at the same place, turned and zoomed towards the mesh.

Two pinhole cameras at one place see pictures that differ by a homography, whatever the depth of the scene. So the warp
is exact; only what lies beyond the picture's border is missing.
"""

from __future__ import annotations

import math

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Camera, Mesh

_MARGIN = 1.08
"""Half the picture's size relative to the mesh's greatest extent from its middle."""
_MOST_TAPS = 16
"""Samples along each side of a pixel, at most."""


def film_coordinates(
    camera: Camera, aspect: float, points: Float[ndarray, "points 3"]
) -> tuple[Float[ndarray, "points 2"], Float[ndarray, " points"]]:
    """Points in film coordinates, x to the right, y up, [-1, 1] inside the picture; and their depths in metres.

    Raises:
        ConfigError: a point is not in front of the camera.
    """
    seen = (points - np.asarray(camera.origin)) @ camera.basis().T
    depth = -seen[:, 2]
    if depth.min() <= 1e-6 * np.abs(seen).max():
        raise ConfigError(
            "the camera does not have all of the mesh in front of it: it stands inside, beside or with its back to it."
        )
    tangent = math.tan(camera.vertical_fov / 2)
    return seen[:, :2] / depth[:, None] / (tangent * aspect, tangent), depth


def rectified_camera(camera: Camera, size: tuple[int, int], mesh: Mesh, film: tuple[int, int]) -> OrbitCamera:
    """The data set's camera, at the same place as the picture's.

    If the picture shows the whole mesh, the camera looks at the middle of its bounding box and shows all of it with a
    margin. Else its image is the largest crop about the picture's middle.

    Args:
        size: width and height of the picture.
        film: width and height of the data set's images.

    Raises:
        ConfigError: the camera does not see the mesh.
    """
    aspect, points = film[0] / film[1], mesh.positions[np.unique(mesh.faces)]
    at, _ = film_coordinates(camera, size[0] / size[1], points)
    if not (np.abs(at) <= 1).all(axis=1).any():
        raise ConfigError("the camera does not see the mesh: no corner of it lies in the picture.")
    middle = mesh.bounds.mean(axis=0)
    if (np.abs(at) <= 1).all():
        centred = Camera(camera.origin, _vector(middle), camera.up, math.pi / 2)
        tangent = _MARGIN * float(np.abs(film_coordinates(centred, aspect, points)[0]).max())
        return _orbit(camera.origin, middle, tangent)
    forward = -camera.basis()[2]
    distance = max(float((middle - camera.origin) @ forward), 1e-3)
    tangent = math.tan(camera.vertical_fov / 2) * min(1.0, size[0] / size[1] / aspect)
    return _orbit(camera.origin, np.asarray(camera.origin) + distance * forward, tangent)


def rectify(
    planes: Float[Tensor, "channels height width"], source: Camera, target: Camera, film: tuple[int, int]
) -> Float[Tensor, "channels rows cols"]:
    """The planes as camera `target` sees them: means over its pixels, zero beyond the border of `source`."""
    width, height = film
    taps = min(_MOST_TAPS, math.ceil(minification(planes.shape[1], source, target, film)))
    across, up = math.tan(target.vertical_fov / 2) * width / height, math.tan(target.vertical_fov / 2)
    x = torch.from_numpy(((np.arange(width * taps) + 0.5) / (width * taps) * 2 - 1) * across)
    y = torch.from_numpy((1 - (np.arange(height * taps) + 0.5) / (height * taps) * 2) * up)
    turn = torch.from_numpy(source.basis() @ target.basis().T)
    half_height = math.tan(source.vertical_fov / 2)
    half = torch.tensor([half_height * planes.shape[2] / planes.shape[1], -half_height], dtype=torch.float64)
    rows = []
    for row in y.split(taps):
        rays = torch.stack([*torch.meshgrid(x, row, indexing="xy"), -torch.ones(len(row), len(x)).double()], dim=-1)
        seen = rays @ turn.T
        # 2 lies outside of the picture, which is where directions behind the source camera belong
        place = torch.where(seen[..., 2:] < 0, seen[..., :2] / -seen[..., 2:] / half, 2.0)
        found = F.grid_sample(planes[None], place[None].float(), align_corners=False)
        rows.append(F.avg_pool2d(found, taps)[0])
    return torch.cat(rows, dim=1)


def minification(height: int, source: Camera, target: Camera, film: tuple[int, int]) -> float:
    """Pixels of the source, which has `height` rows, along one pixel of the target; below 1 the source is enlarged."""
    return math.tan(target.vertical_fov / 2) / math.tan(source.vertical_fov / 2) * height / film[1]


def _orbit(origin: tuple[float, float, float], target: Float[ndarray, " 3"], tangent: float) -> OrbitCamera:
    """The camera at `origin` that looks at `target`; `tangent` is that of half its vertical angle."""
    x, y, z = np.asarray(origin) - target
    distance = math.sqrt(x * x + y * y + z * z)
    elevation = math.degrees(math.asin(y / distance))
    if abs(elevation) > 89.9:
        raise ConfigError("the camera looks straight down or up, where azimuth has no meaning; move it a little.")
    return OrbitCamera(
        azimuth_degrees=math.degrees(math.atan2(x, z)) % 360.0,
        elevation_degrees=elevation,
        distance=distance,
        target=_vector(target),
        vertical_fov_degrees=math.degrees(2 * math.atan(tangent)),
    )


def _vector(point: Float[ndarray, " 3"]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in point)
    return x, y, z
