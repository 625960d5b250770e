"""Warps a picture to the data set's camera, which stands at the same place, turned and zoomed towards the mesh.

What a camera sees in a direction depends on its place alone, whatever the depth of the scene. So a warp from any lens
and any angle to a level pinhole camera is exact; only what lies beyond the picture's border is missing.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.errors import ConfigError
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Camera, Mesh

_MARGIN = 1.08
"""Half the picture's size relative to the mesh's greatest extent from its middle."""
_MOST_TAPS = 16
"""Samples along each side of a pixel, at most."""
_UP = (0.0, 1.0, 0.0)


def shows_whole(camera: CalibratedCamera, points: Float[ndarray, "points 3"]) -> bool:
    """Whether the picture shows all points.

    Raises:
        ConfigError: it shows none of them, or they are not in front of the camera.
    """
    shown = (np.abs(camera.film_coordinates(points)[0]) <= 1).all(axis=1)
    if not shown.any():
        raise ConfigError("the camera does not see the mesh: no corner of it lies in the picture.")
    return bool(shown.all())


def rectified_camera(camera: CalibratedCamera, mesh: Mesh, film: tuple[int, int]) -> OrbitCamera:
    """The data set's camera, level and at the same place as the picture's.

    If the picture shows the whole mesh, the camera looks at the middle of its bounding box and shows all of it with a
    margin. Else its image is the largest that the picture fills, about the picture's middle.

    Args:
        film: width and height of the data set's images.

    Raises:
        ConfigError: the camera does not see the mesh.
    """
    points, middle = mesh.positions[np.unique(mesh.faces)], mesh.bounds.mean(axis=0)
    if shows_whole(camera, points):
        centred = CalibratedCamera.of(Camera(camera.position, _vector(middle), vertical_fov=math.pi / 2), film)
        tangent = _MARGIN * float(np.abs(centred.film_coordinates(points)[0]).max())
        return _orbit(camera.position, middle, tangent)
    whole, position = camera.pinhole(), np.asarray(camera.position)
    forward = -whole.basis()[2]
    target = position + max(float((middle - position) @ forward), 1e-3) * forward
    return _orbit(camera.position, target, _filled(camera, replace(whole, target=_vector(target), up=_UP), film))


def _filled(source: CalibratedCamera, target: Camera, film: tuple[int, int]) -> float:
    """The tangent of half the vertical angle at which `target` sees nothing beyond the border of `source`."""
    side, full = np.linspace(-1, 1, 33), np.ones(33)
    border = np.concatenate([np.stack([side, full], axis=1), np.stack([full, side], axis=1)])
    border = np.concatenate([border, -border]) * (film[0] / film[1], 1.0)
    least, most = 0.0, 2 * math.tan(target.vertical_fov / 2)
    for _ in range(50):
        middle = (least + most) / 2
        rays = np.concatenate([middle * border, -np.ones((len(border), 1))], axis=1)
        inside = np.abs(source.project(rays @ target.basis() @ source.basis().T)) <= 1
        least, most = (middle, most) if inside.all() else (least, middle)
    return least


def rectify(
    planes: Float[Tensor, "channels height width"], source: CalibratedCamera, target: Camera, film: tuple[int, int]
) -> Float[Tensor, "channels rows cols"]:
    """The planes as camera `target` sees them: means over its pixels, zero beyond the border of `source`."""
    width, height = film
    # not one more for a ratio that is an integer but for rounding
    taps = min(_MOST_TAPS, math.ceil(minification(planes.shape[1], source, target, film) - 1e-6))
    across, up = math.tan(target.vertical_fov / 2) * width / height, math.tan(target.vertical_fov / 2)
    x = ((np.arange(width * taps) + 0.5) / (width * taps) * 2 - 1) * across
    y = (1 - (np.arange(height * taps) + 0.5) / (height * taps) * 2) * up
    turn = target.basis() @ source.basis().T
    rows = []
    for row in np.split(y, height):
        rays = np.stack([*np.meshgrid(x, row), np.full((taps, len(x)), -1.0)], axis=-1)
        # 2 lies outside of the picture, which is where directions belong that the source does not see
        place = torch.from_numpy(np.nan_to_num(source.project(rays @ turn) * (1, -1), nan=2.0)).float()
        found = F.grid_sample(planes[None], place[None], align_corners=False)
        rows.append(F.avg_pool2d(found, taps)[0])
    return torch.cat(rows, dim=1)


def minification(height: int, source: CalibratedCamera, target: Camera, film: tuple[int, int]) -> float:
    """Pixels of the source, which has `height` rows, along one pixel of the target; below 1 the source is enlarged."""
    return 2 * math.tan(target.vertical_fov / 2) * source.focal[1] / source.size[1] * height / film[1]


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
