"""A surface on the device: its faces, a tree over them, and their attributes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from svbrdfgan.types import Surface, View
from svbrdfgan_warp import device as devices
from svbrdfgan_warp import kernels, lookup
from svbrdfgan_warp.tree import plant


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """Geometry on one device, moved so that `centre` lies at the origin, where float32 is finest.

    Attributes:
        geometry: what the kernels read.
        centre: middle of the bounding box in the surface's own coordinates.
        parts: the parts' names.
        repeat: `Surface.repeat`.
    """

    geometry: kernels.Geometry
    centre: Float[ndarray, 3]
    parts: tuple[str, ...]
    repeat: tuple[bool, bool]
    device: torch.device


def prepare(surface: Surface, device: torch.device) -> PreparedSurface:
    """The surface on `device`, ready in any stream."""
    used = np.zeros(len(surface.positions), dtype=bool)
    used[surface.faces] = True
    low, high = (bound(surface.positions[used], axis=0) for bound in (np.min, np.max))
    centre = (low + high) / 2

    def floats(values: ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32)).to(device)

    def integers(values: ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(values.reshape(-1), dtype=np.int32)).to(device)

    points, corners = floats(surface.positions - centre), integers(surface.faces)
    geometry: Any = kernels.Geometry()
    with devices.quiet():
        for module in (kernels, lookup):
            wp.load_module(module, device=wp.device_from_torch(device))
        geometry.nodes, geometry.triangles = plant(points, corners)
    geometry.radius = float(np.linalg.norm(high - low)) / 2
    geometry.points, geometry.corners = wp.from_torch(points, wp.vec3), wp.from_torch(corners)
    geometry.normals = wp.from_torch(floats(surface.normals), wp.vec3)
    geometry.uv = wp.from_torch(floats(surface.uv), wp.vec2)
    geometry.face_part = wp.from_torch(integers(surface.face_part))
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return PreparedSurface(geometry, centre, tuple(part.name for part in surface.parts), surface.repeat, device)


def lens(view: View, centre: Float[ndarray, 3]) -> kernels.Lens:
    """The camera in the prepared surface's coordinates; its axes are scaled to half the film's width and height."""
    camera = view.camera
    right, top, backward = camera.basis()
    half = np.tan(camera.vertical_fov / 2)
    result: Any = kernels.Lens()
    result.origin = wp.vec3(*(np.asarray(camera.origin, dtype=np.float64) - centre))
    result.right = wp.vec3(*(right * half * view.width / view.height))
    result.top = wp.vec3(*(top * half))
    result.forward = wp.vec3(*-backward)
    result.width, result.height = view.width, view.height
    return result
