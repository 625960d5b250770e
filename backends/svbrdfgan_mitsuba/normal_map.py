"""The frame of the surface at many points, and the normals that normal maps make there (`docs/conventions.md`)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import torch

from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.types import Surface
from svbrdfgan_mitsuba.interop import dr, floats


@dataclass(frozen=True, eq=False)
class TangentFrames:
    """The tangents of a surface, made when the first material with a normal map needs them."""

    mi: Any
    surface: Surface
    device: torch.device

    def at(self, intersection: Any, normal: Any, toward: Any, found: Any) -> Any:
        """The frame (T, B, `toward`) at each intersection.

        Args:
            normal: the unit shading normal.
            toward: the same, turned to the viewer.
        """
        mi, (directions, handedness) = self.mi, self._corners
        face, (second, third) = intersection.prim_index, intersection.prim_uv
        corners = [dr.gather(mi.Vector3f, directions, face * 3 + corner, found) for corner in range(3)]
        tangent = corners[0] * (1.0 - second - third) + corners[1] * second + corners[2] * third
        tangent = tangent - normal * dr.dot(normal, tangent)
        length = dr.squared_norm(tangent)
        # Tangents that cancel leave no direction; any will do, as for misses.
        tangent = dr.select(length > 1e-12, tangent / dr.sqrt(length), mi.Frame3f(normal).s)
        side = dr.gather(mi.Float, handedness, face, found)
        return mi.Frame3f(tangent, dr.cross(normal, tangent) * dr.select(found, side, 1.0), toward)

    @cached_property
    def _corners(self) -> tuple[Any, Any]:
        tangents = corner_tangents(self.surface)
        return tuple(
            floats(self.mi, torch.from_numpy(array.astype(np.float32)), self.device)
            for array in (tangents.direction, tangents.handedness)
        )


def tilted_normal(mi: Any, texel: Any, given: Any, behind: Any, viewer: Any) -> Any:
    """The normal n that a normal map makes, a unit vector in the frame (T, B, N); differentiable by `texel`.

    Args:
        texel: the value of the map, of any length.
        given: whether there is a map; n is N, the z axis, where there is none.
        behind: whether the viewer is behind the surface, so that N was turned.
        viewer: unit direction to the viewer in the frame; its z is not negative.
    """
    length = dr.squared_norm(texel)
    given = given & (length > 1e-12)  # a map of no length has no direction: it changes nothing
    normal = texel / dr.sqrt(dr.select(given, length, 1.0))
    normal = mi.Vector3f(dr.select(behind, -normal.x, normal.x), dr.select(behind, -normal.y, normal.y), normal.z)
    return dr.select(given, _bent(normal, viewer), mi.Vector3f(0.0, 0.0, 1.0))


def _bent(normal: Any, viewer: Any) -> Any:
    """The normal, bent towards the viewer just until the viewer's mirror direction about it is not below z = 0."""
    a, b = normal.z, viewer.z
    below = b - 2.0 * a * dr.dot(normal, viewer)
    bend = below > 0.0
    root = dr.sqrt(dr.select(bend, dr.fma(a, a, b * below), 1.0))
    # The two forms are equal; each does not cancel for its sign of a.
    far = dr.select(bend, below, 0.0) / dr.select(bend & (a > 0.0), a + root, 1.0)
    near = (root - a) / dr.maximum(b, 1e-12)  # finite for a viewer on the horizon
    k = dr.select(bend, dr.select(a > 0.0, far, near), 0.0)
    return dr.normalize(normal + viewer * k)
