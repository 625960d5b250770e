"""Writes known cameras as files of COLMAP and NeRF, and projects points by OpenCV's own axes and formulas."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True, eq=False)
class Taken:
    """A picture's name, and the OpenCV camera that took it.

    Attributes:
        rotation, shift: from the world to the camera, with x to the right, y down and z forward.
        lens: fx, fy, cx, cy, k1, k2, p1, p2.
    """

    name: str
    rotation: np.ndarray
    shift: np.ndarray
    size: tuple[int, int]
    lens: tuple[float, ...]

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Where OpenCV's `projectPoints` sees points, with the upper left corner of the picture at 0."""
        x, y, depth = (points @ self.rotation.T + self.shift).T
        x, y = x / depth, y / depth
        fx, fy, cx, cy, k1, k2, p1, p2 = self.lens
        square = x**2 + y**2
        radial = 1 + k1 * square + k2 * square**2
        u = x * radial + 2 * p1 * x * y + p2 * (square + 2 * x**2)
        v = y * radial + p1 * (square + 2 * y**2) + 2 * p2 * x * y
        return np.stack([fx * u + cx, fy * v + cy], axis=-1)

    @property
    def quaternion(self) -> list[float]:
        x, y, z, w = Rotation.from_matrix(self.rotation).as_quat().tolist()
        return [w, x, y, z]

    @property
    def camera_to_world(self) -> np.ndarray:
        """In OpenCV's axes."""
        made = np.eye(4)
        made[:3, :3], made[:3, 3] = self.rotation.T, -self.rotation.T @ self.shift
        return made


def take(name: str, azimuth: float, roll: float, size: tuple[int, int], lens: tuple[float, ...]) -> Taken:
    """A camera about 2.2 metres from the origin's neighbourhood, rolled. Angles in degrees."""
    a, elevation = math.radians(azimuth), math.radians(18)
    position = 2.2 * np.array([math.cos(elevation) * math.sin(a), 0.4, math.cos(elevation) * math.cos(a)])
    forward = np.array([0.0, 0.2, 0.0]) - position
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    level = np.stack([right, np.cross(forward, right), forward])
    rotation = Rotation.from_euler("z", roll, degrees=True).as_matrix() @ level
    return Taken(name, rotation, -rotation @ position, size, lens)


def moved(taken: Taken, matrix: np.ndarray) -> Taken:
    """The same camera in a world that a similarity transform maps to the old one."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    rotation = taken.rotation @ matrix[:3, :3] / scale
    shift = (taken.rotation @ matrix[:3, 3] + taken.shift) / scale
    return Taken(taken.name, rotation, shift, taken.size, taken.lens)


def write_colmap_text(folder: Path, pictures: Sequence[Taken]) -> None:
    folder.mkdir(parents=True)
    cameras, images = ["# Camera list"], ["# Image list", "# two lines for each"]
    for number, one in enumerate(pictures, 1):
        cameras.append(f"{number} OPENCV {one.size[0]} {one.size[1]} " + " ".join(map(repr, one.lens)))
        pose = " ".join(repr(float(value)) for value in (*one.quaternion, *one.shift))
        # the second picture has no points, which is an empty line
        images += [f"{number + 7} {pose} {number} {one.name}", "" if number == 2 else "1.5 2.5 -1 3.0 4.0 17"]
    (folder / "cameras.txt").write_text("\n".join(cameras) + "\n")
    (folder / "images.txt").write_text("\n".join(images) + "\n")


def write_colmap_binary(folder: Path, pictures: Sequence[Taken]) -> None:
    folder.mkdir(parents=True)
    cameras = images = struct.pack("<Q", len(pictures))
    for number, one in enumerate(pictures, 1):
        cameras += struct.pack("<iiQQ8d", number, 4, *one.size, *one.lens)
        images += struct.pack("<I7dI", number + 7, *one.quaternion, *one.shift, number) + one.name.encode() + b"\0"
        points = number % 3
        images += struct.pack("<Q", points) + struct.pack("<ddq", 1.5, 2.5, -1) * points
    (folder / "cameras.bin").write_bytes(cameras)
    (folder / "images.bin").write_bytes(images)


def nerf(pictures: Sequence[Taken]) -> dict[str, Any]:
    """The contents of a `transforms.json` whose first camera is that of the file, and others that of their frames."""
    frames: list[dict[str, Any]] = []
    for one in pictures:
        matrix = one.camera_to_world @ np.diag([1.0, -1.0, -1.0, 1.0])
        names = ("w", "h", "fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2")
        lens = dict(zip(names, (*one.size, *one.lens), strict=True))
        frames.append({"file_path": f"./{one.name}", "transform_matrix": matrix.tolist(), **lens})
    shared = {name: frames[0].pop(name) for name in names}
    return {"camera_model": "OPENCV", "aabb_scale": 4, **shared, "frames": frames}


def write_nerf(path: Path, pictures: Sequence[Taken]) -> None:
    path.write_text(json.dumps(nerf(pictures)))
