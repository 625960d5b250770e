"""Reads NeRF's `transforms.json`, as instant-ngp and nerfstudio write it, and a like form with OpenCV's axes."""

from __future__ import annotations

import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ConfigDict, Field, model_validator

from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.photos.alignment import Matrix
from svbrdfgan.data.photos.colmap import LENS_MODELS
from svbrdfgan.data.photos.frames import Frame
from svbrdfgan.data.photos.photo import photo_size
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.records import load_json

_OTHER_NAMES = {
    "file": "file_path",
    "focal": "fl_x",
    "height": "h",
    "mask": "mask_path",
    "model": "camera_model",
    "width": "w",
}
"""Keys of the like form, and NeRF's. Its `camera_to_world` is a `transform_matrix` in OpenCV's axes."""


class _Values(StrictModel):
    """The keys of a frame, or of the file for all frames, that matter here; others are ignored."""

    model_config = ConfigDict(extra="ignore")

    transform_matrix: Matrix | None = None
    camera_to_world: Matrix | None = None
    camera_model: str = "OPENCV"
    is_fisheye: bool = False
    w: float | None = Field(default=None, gt=0)
    h: float | None = Field(default=None, gt=0)
    fl_x: float | None = Field(default=None, gt=0)
    fl_y: float | None = Field(default=None, gt=0)
    camera_angle_x: float | None = Field(default=None, gt=0, lt=math.pi)
    camera_angle_y: float | None = Field(default=None, gt=0, lt=math.pi)
    cx: float | None = None
    cy: float | None = None
    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    p1: float = 0.0
    p2: float = 0.0

    @model_validator(mode="after")
    def _is_known(self) -> _Values:
        if self.is_fisheye or self.camera_model not in LENS_MODELS or self.k3 or self.k4:
            raise ValueError(
                "the lens model is a fisheye, or has k3 or k4; known are k1, k2, p1 and p2: undistort the pictures"
            )
        if self.fl_x is None and self.camera_angle_x is None:
            raise ValueError("there is neither 'fl_x' nor 'camera_angle_x', so that the field of view is not known")
        if self.transform_matrix is None and self.camera_to_world is None:
            raise ValueError("key 'transform_matrix' is missing")
        return self


def read_transforms(path: Path) -> list[Frame]:
    """The frames of a `transforms.json`; what a frame does not say itself, the file says for all.

    Raises:
        AssetError: the file is missing or not JSON.
        ConfigError: it has no list of frames that name pictures.
    """
    data = load_json(path)
    frames = data.get("frames") if isinstance(data, dict) else None
    if not isinstance(frames, list):
        raise ConfigError(f"{path} has no list 'frames'; wanted NeRF's transforms.json.")
    shared = {key: value for key, value in data.items() if key != "frames"}
    return [_frame(shared, frame, f"{path.name}: frames[{number}]") for number, frame in enumerate(frames)]


def _frame(shared: dict[str, Any], frame: object, source: str) -> Frame:
    own = frame if isinstance(frame, dict) else {}
    values = {_OTHER_NAMES.get(key, key): value for key, value in {**shared, **own}.items()}
    name, mask = values.get("file_path"), values.get("mask_path")
    if not isinstance(name, str):
        raise ConfigError(f"{source} names no picture; wanted text as 'file_path'.")
    return Frame(name, partial(_camera, values, source), mask if isinstance(mask, str) else None)


def _camera(data: dict[str, Any], source: str, picture: Path) -> dict[str, Any]:
    values = validate(_Values, data, source)
    width, height = (values.w, values.h) if values.w and values.h else photo_size(picture)
    across = values.fl_x or width / 2 / math.tan((values.camera_angle_x or 0) / 2)
    up = height / 2 / math.tan(values.camera_angle_y / 2) if values.camera_angle_y and not values.fl_x else across
    pose = np.asarray(values.transform_matrix or values.camera_to_world)
    if values.transform_matrix is None:
        pose = pose @ np.diag([1.0, -1.0, -1.0, 1.0])  # from OpenCV's axes, with y down and z forward
    return {
        "camera_to_world": pose.tolist(),
        "size": [width, height],
        "focal": [across, values.fl_y or up],
        "center": [width / 2 if values.cx is None else values.cx, height / 2 if values.cy is None else values.cy],
        "distortion": [values.k1, values.k2, values.p1, values.p2],
    }
