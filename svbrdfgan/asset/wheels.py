"""Wheels found by their shape: what is round, stands on the ground, and has at least one companion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from svbrdfgan.io.rows import merge_rows

_DIRECTIONS = 16
_ROUND = 0.1
"""Relative deviation of a wheel's widths from a circle's; a hexagon has 0.093, a square 0.21."""
_CENTRED = 0.2
"""Likewise, of its reach from the middle of its box; a triangle, whose widths are even, has 0.4."""
_CONTACT = 0.06  # of the height: how far above the ground a wheel may end
_DIAMETERS = (0.08, 0.92)  # of the height
_OUTER = 0.92  # of the radius, from which on a shell reaches to the ground
_SLACK = 1.06  # of the radius, within which things belong to a wheel


@dataclass(frozen=True, eq=False)
class Wheel:
    """A cylinder about a horizontal axis.

    Attributes:
        axis: 0 for X and 2 for Z.
        centre, radius: in the plane of the two other axes, in their order.
        extent: lowest and greatest coordinate along the axis.
    """

    axis: int
    centre: Float[ndarray, " 2"]
    radius: float
    extent: tuple[float, float]

    def reach(self, points: Float[ndarray, "points 3"]) -> float:
        """The greatest distance of points from the axis, in radii of the wheel."""
        across = np.delete(points, self.axis, axis=1) - self.centre
        return float(np.linalg.norm(across, axis=1).max()) / self.radius

    def holds(self, points: Float[ndarray, "points 3"]) -> bool:
        """Whether all points lie in the wheel, or as far beside it as it is wide."""
        along = points[:, self.axis]
        low, high = self.extent
        near = (along > low - (high - low)).all() and (along < high + (high - low)).all()
        return bool(near) and self.reach(points) <= _SLACK


@dataclass(frozen=True, eq=False)
class WheelFaces:
    """Faces that belong to wheels.

    Attributes:
        inside: of each face, whether it belongs to one.
        tread: likewise, whether it is of a connected piece that reaches to the ground, as tyres do and rims do not.
    """

    inside: Bool[ndarray, " faces"]
    tread: Bool[ndarray, " faces"]
    wheels: tuple[Wheel, ...]


def find_wheels(
    positions: Float[ndarray, "vertices 3"],
    faces: Int[ndarray, "faces 3"],
    piece: Int[ndarray, " faces"],
    low: float,
    height: float,
) -> WheelFaces:
    """The faces of wheels.

    Args:
        positions: Y up.
        piece: of each face; faces of different pieces are not connected.
        low, height: of the vehicle. What stands on the ground ends at `low`.
    """
    shell = shells(faces, piece)
    order = np.argsort(shell, kind="stable")
    members = np.split(order, np.flatnonzero(np.diff(shell[order])) + 1)
    corners = [positions[np.unique(faces[member])] for member in members]
    wheels = [found for points in corners if (found := _wheel(points, low, height)) is not None]
    inside, tread = np.zeros(len(faces), bool), np.zeros(len(faces), bool)
    if len(wheels) < 2:
        return WheelFaces(inside, tread, ())
    for member, points in zip(members, corners, strict=True):
        around = [wheel for wheel in wheels if wheel.holds(points)]
        if around:
            inside[member] = True
            tread[member] = max(around, key=lambda wheel: wheel.radius).reach(points) > _OUTER
    return WheelFaces(inside, tread, tuple(wheels))


def shells(faces: Int[ndarray, "faces 3"], piece: Int[ndarray, " faces"]) -> Int[ndarray, " faces"]:
    """For each face, the number of the connected shell of its piece that it belongs to."""
    pairs = np.column_stack([np.repeat(piece, 3), faces.ravel()]).astype(np.float64)
    rows, vertex = merge_rows(pairs)
    a, b, c = vertex.reshape(-1, 3).T
    graph = coo_matrix((np.ones(2 * len(faces)), (np.r_[a, a], np.r_[b, c])), shape=(len(rows), len(rows)))
    return np.asarray(connected_components(graph, directed=False)[1])[a]


def _wheel(points: Float[ndarray, "points 3"], low: float, height: float) -> Wheel | None:
    """The wheel that these vertices of one shell are; None if they are none."""
    bottom, top = points.min(axis=0), points.max(axis=0)
    size = top - bottom
    if bottom[1] > low + _CONTACT * height or not _DIAMETERS[0] < size[1] / height < _DIAMETERS[1]:
        return None
    for axis in (0, 2):
        flat, centre = np.delete(points, axis, axis=1), np.delete(0.5 * (bottom + top), axis)
        if _is_round(flat - centre):
            radius = float(np.linalg.norm(flat - centre, axis=1).max())  # half the height is less for a nonagon
            return Wheel(axis, centre, radius, (float(bottom[axis]), float(top[axis])))
    return None


def _is_round(flat: Float[ndarray, "points 2"]) -> bool:
    """Whether the convex outline is a circle about the origin."""
    turn = np.arange(_DIRECTIONS) * (2.0 * np.pi / _DIRECTIONS)
    reach = (flat @ np.stack([np.cos(turn), np.sin(turn)])).max(axis=0)
    width = reach + np.roll(reach, _DIRECTIONS // 2)
    even = bool(np.abs(width / width.mean() - 1.0).max() < _ROUND)
    return even and bool(np.abs(reach / reach.mean() - 1.0).max() < _CENTRED)
