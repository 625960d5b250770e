"""What all surfaces of one shape share on a device, such as their BVH; and a cache, in which windows find theirs."""

from __future__ import annotations

import threading
import weakref
from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import torch
import warp as wp
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.types import Surface
from svbrdfgan_warp.bvh import build_bvh
from svbrdfgan_warp.device import finish, quiet
from svbrdfgan_warp.frame import TangentSpace


@dataclass(frozen=True, eq=False)
class Shape:
    """Faces with their normals, and what is made of them, on one device.

    Attributes:
        points: moved so that the middle of the bounding box lies at the origin, where float32 is finest.
        corners: of the faces.
        nodes, triangles: of the BVH, as kernels take them.
    """

    points: Float[Tensor, "vertices 3"]
    corners: Int[Tensor, " 3_faces"]
    normals: Float[Tensor, "vertices 3"]
    nodes: Any
    triangles: Any
    _tangents: list[tuple[Float[ndarray, "vertices 2"], TangentSpace]] = field(default_factory=list)

    def tangent_space(self, surface: Surface) -> TangentSpace:
        """The tangents of a surface of this shape; the last are kept for the other windows of its map."""
        uv = surface.uv if surface.whole_uv is None else surface.whole_uv
        for known, space in self._tangents:
            if np.array_equal(known, uv):
                return space
        space = self._tangent_space(surface)
        self._tangents[:] = [(uv.copy(), space)]
        return space

    def _tangent_space(self, surface: Surface) -> TangentSpace:
        tangents, result = corner_tangents(surface), cast(Any, TangentSpace())
        direction, handedness = (
            on_device(values, np.float32, self.points.device) for values in (tangents.direction, tangents.handedness)
        )
        result.tangents, result.handedness = wp.from_torch(direction, wp.vec3), wp.from_torch(handedness)
        finish(self.points.device)
        return cast(TangentSpace, result)


class ShapeCache:
    """The shapes that some prepared surface of one device still has, found by their contents.

    Windows of one map, of which there are thousands, differ in their UVs alone. Their BVHs and tangents take most of
    the time of storing their light, and gigabytes.
    """

    def __init__(self, device: torch.device) -> None:
        self._device = device
        self._shapes: weakref.WeakSet[Shape] = weakref.WeakSet()
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return len(self._shapes)

    def shape(self, surface: Surface, centre: Float[ndarray, 3]) -> Shape:
        """The shape of the surface, ready for use in any CUDA stream."""
        points, normals = (
            on_device(values, np.float32, self._device) for values in (surface.positions - centre, surface.normals)
        )
        corners = on_device(surface.faces.reshape(-1), np.int32, self._device)
        with self._lock:
            for known in self._shapes:
                both = ((points, known.points), (corners, known.corners), (normals, known.normals))
                if all(torch.equal(given, own) for given, own in both):
                    return known
            with quiet():
                shape = Shape(points, corners, normals, *build_bvh(points, corners))
            finish(self._device)
            self._shapes.add(shape)
            return shape


def on_device(values: ndarray, dtype: type, device: torch.device) -> Tensor:
    """A copy of the values on the device."""
    return torch.from_numpy(np.array(values, dtype=dtype, order="C")).to(device)
