"""A surface on the device: triangles, their BVH and their attributes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.types import Surface, View
from svbrdfgan_warp import device as devices
from svbrdfgan_warp import kernels


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """Geometry on one device, moved so that `centre` lies at the origin, where float32 is finest.

    Attributes:
        geometry: what the kernels read.
        mesh: the triangles and their BVH; held here because `geometry` names it by number only.
        centre: middle of the bounding box in the surface's own coordinates.
        parts: the parts' names.
        repeat: `Surface.repeat`.
    """

    geometry: kernels.Geometry
    mesh: wp.Mesh
    centre: Float[ndarray, 3]
    parts: tuple[str, ...]
    repeat: tuple[bool, bool]
    device: torch.device


def prepare(surface: Surface, device: torch.device) -> PreparedSurface:
    """The surface on `device`, ready in any stream. The constructors are those that traced fastest on each."""
    used = surface.positions[np.unique(surface.faces)]
    centre = (used.min(axis=0) + used.max(axis=0)) / 2

    def array(values: ndarray, dtype: type) -> Any:
        kind = np.int32 if dtype is wp.int32 else np.float32
        return wp.from_torch(torch.from_numpy(np.ascontiguousarray(values, dtype=kind)).to(device), dtype=dtype)

    constructor = "cubql" if device.type == "cuda" and wp.is_cubql_available() else None
    stream = devices.stream(device)
    with devices.quiet(), wp.ScopedStream(stream) if stream else wp.ScopedDevice(wp.device_from_torch(device)):
        wp.load_module(kernels, device=wp.device_from_torch(device))
        points, corners = array(surface.positions - centre, wp.vec3), array(surface.faces.reshape(-1), wp.int32)
        mesh = wp.Mesh(points, corners, bvh_constructor=constructor)
        geometry: Any = kernels.Geometry()
        geometry.mesh, geometry.points, geometry.corners = mesh.id, points, corners
        geometry.normals = array(surface.normals, wp.vec3)
        geometry.uv = array(surface.uv, wp.vec2)
        geometry.face_part = array(surface.face_part, wp.int32)
    if device.type == "cuda":
        torch.cuda.synchronize(device)
    return PreparedSurface(geometry, mesh, centre, tuple(part.name for part in surface.parts), surface.repeat, device)


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
