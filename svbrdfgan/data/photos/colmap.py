"""Reads cameras and poses of COLMAP's models, text and binary (https://colmap.github.io/format.html)."""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from svbrdfgan.data.photos.frames import Frame
from svbrdfgan.errors import AssetError, ConfigError

Item = TypeVar("Item")

LENS_MODELS = {
    "SIMPLE_PINHOLE": (0, "f cx cy"),
    "PINHOLE": (1, "fx fy cx cy"),
    "SIMPLE_RADIAL": (2, "f cx cy k1"),
    "RADIAL": (3, "f cx cy k1 k2"),
    "OPENCV": (4, "fx fy cx cy k1 k2 p1 p2"),
}
"""The lens models that `CalibratedCamera` covers: COLMAP's number of each, and its parameters."""

_NAMES = {number: name for name, (number, _) in LENS_MODELS.items()}
_OPENGL = np.diag([1.0, -1.0, -1.0])
"""From COLMAP's axes of a camera, with y down and z forward, to ours."""


@dataclass(frozen=True)
class _Pose:
    """A picture's name, the number of its camera, and the map from the world to it: quaternion (w, x, y, z), shift."""

    name: str
    camera: int
    quaternion: tuple[float, ...]
    shift: tuple[float, ...]


def read_colmap(folder: Path) -> list[Frame]:
    """The frames of a model: of `cameras.bin` and `images.bin` or, without them, of the files of text.

    Raises:
        AssetError: the files are missing or broken.
        ConfigError: a camera has a lens model other than `SIMPLE_PINHOLE`, `PINHOLE`, `SIMPLE_RADIAL`, `RADIAL` and
            `OPENCV`, or a picture names a camera that there is not.
    """
    for suffix, read_cameras, read_poses in (
        (".bin", _binary_cameras, _binary_poses),
        (".txt", _text_cameras, _text_poses),
    ):
        files = folder / f"cameras{suffix}", folder / f"images{suffix}"
        if all(file.is_file() for file in files):
            cameras = dict(_parsed(files[0], read_cameras))
            return [_frame(pose, cameras, files[0]) for pose in _parsed(files[1], read_poses)]
    raise AssetError(
        f"{folder} holds no COLMAP model: wanted cameras.bin and images.bin, or cameras.txt and images.txt."
    )


def _parsed(path: Path, read: Callable[[bytes], Iterator[Item]]) -> list[Item]:
    try:
        return list(read(path.read_bytes()))
    except OSError as error:
        raise AssetError(f"{path} cannot be read: {error.strerror or error}.") from error
    except (ValueError, IndexError, OverflowError, struct.error) as error:  # UnicodeDecodeError is a ValueError
        raise AssetError(f"{path} is not a file of COLMAP, or is cut off: {error}.") from error
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _frame(pose: _Pose, cameras: dict[int, dict[str, Any]], path: Path) -> Frame:
    if pose.camera not in cameras:
        raise ConfigError(f"{path} has no camera {pose.camera}, which {pose.name} is taken with.")
    turn = _OPENGL @ _rotation(pose.quaternion)
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turn.T, -turn.T @ _OPENGL @ pose.shift
    camera = {"camera_to_world": made.tolist(), **cameras[pose.camera]}
    return Frame(pose.name, lambda _: camera)


def _rotation(quaternion: tuple[float, ...]) -> np.ndarray:
    with np.errstate(invalid="ignore"):  # a quaternion of zeros gives NaN, which the camera's check refuses
        w, x, y, z = np.asarray(quaternion) / np.linalg.norm(quaternion)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + 2 * w * cross + 2 * cross @ cross


def _lens(number: int, model: str, width: float, height: float, given: tuple[float, ...]) -> dict[str, Any]:
    names = _parameters(number, model)
    if len(names) != len(given):
        raise ConfigError(f"camera {number} has {len(given)} parameters; {model} has {len(names)}.")
    value = dict(zip(names, given, strict=True))
    return {
        "size": [width, height],
        "focal": [value.get("fx", value.get("f")), value.get("fy", value.get("f"))],
        "center": [value["cx"], value["cy"]],
        "distortion": [value.get(name, 0.0) for name in ("k1", "k2", "p1", "p2")],
    }


def _parameters(number: int, model: str) -> list[str]:
    if model not in LENS_MODELS:
        raise ConfigError(
            f"camera {number} has the lens model {model}; known are {', '.join(LENS_MODELS)}: undistort the pictures "
            "by `colmap image_undistorter`, or calibrate again with OPENCV."
        )
    return LENS_MODELS[model][1].split()


def _text_cameras(data: bytes) -> Iterator[tuple[int, dict[str, Any]]]:
    for line in data.decode().splitlines():
        if line.strip() and not line.startswith("#"):
            number, model, width, height, *given = line.split()
            yield int(number), _lens(int(number), model, float(width), float(height), tuple(map(float, given)))


def _text_poses(data: bytes) -> Iterator[_Pose]:
    lines = iter(data.decode().splitlines())
    for line in lines:
        if line.strip() and not line.startswith("#"):
            _, *pose, camera, name = line.split(maxsplit=9)
            values = tuple(map(float, pose))
            if len(values) != 7:
                raise ValueError(f"{name.strip()} has a pose of {len(values)} numbers; wanted 7")
            yield _Pose(name.strip(), int(camera), values[:4], values[4:])
            next(lines, None)  # the picture's points, a line that may be empty


def _binary_cameras(data: bytes) -> Iterator[tuple[int, dict[str, Any]]]:
    (count,), at = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        number, kind, width, height = struct.unpack_from("<iiQQ", data, at)
        model = _NAMES.get(kind, f"number {kind}")
        given = struct.unpack_from(f"<{len(_parameters(number, model))}d", data, at + 24)
        at += 24 + 8 * len(given)
        yield number, _lens(number, model, width, height, given)


def _binary_poses(data: bytes) -> Iterator[_Pose]:
    (count,), at = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        _, *pose, camera = struct.unpack_from("<I7dI", data, at)
        end = data.index(b"\0", at + 64)
        (points,) = struct.unpack_from("<Q", data, end + 1)
        yield _Pose(data[at + 64 : end].decode(), camera, tuple(pose[:4]), tuple(pose[4:]))
        at = end + 9 + 24 * points
