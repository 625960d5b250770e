"""Flattens a disk: with a conformal map (Levy et al. 2002) or the least L2 stretch (Sander et al. 2001)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import igl
import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.errors import EmbeddingError
from svbrdfgan_igl.boundary_barrier import BoundaryBarrier
from svbrdfgan_igl.collision_barrier import SelfCollisionBarrier
from svbrdfgan_igl.crossing import loop_crosses_itself
from svbrdfgan_igl.energy import DistortionEnergy, RestTriangles
from svbrdfgan_igl.minimise import Objective, minimise
from svbrdfgan_igl.topology import Disk
from svbrdfgan_igl.tutte import tutte

Boundary = Literal["free", "square", "disk"]
Flatten = Callable[[Disk, Boundary, float], Float[ndarray, "vertices 2"]]

_ROUNDS = 60
_TOLERANCE = 1e-6  # of the energy: the descent stops when the slope along a step is smaller
_STIFFNESS = 0.02  # of the barriers: at rest the border stays a two-hundredth of the square's side from its walls
_HOPELESS = 1e60  # initial energy beyond which its second derivatives overflow
TOO_THIN = "the mesh has parts too thin and long to be spread out; allow more 'seams', or split it."
_LEAST_GAP = 1e-3  # of the square's side: least gap between two stretches of the border
# cost of area in the plane with a free boundary: at 1, an undistorted chart would have the area of the square, and
# lower costs press it against the container
_PRESSURE = 0.5


def least_stretch(disk: Disk, boundary: Boundary, gap: float, rounds: int = _ROUNDS) -> Float[ndarray, "vertices 2"]:
    """A one-to-one map into [-0.5, 0.5]^2 with as little L2 stretch as the boundary allows.

    With a free boundary, area in the plane has a cost: the chart fills less of the square, with less stretch.

    Args:
        gap: half the distance at which stretches of the border begin to repel each other, in sides of the square.

    Raises:
        EmbeddingError: parts of the disk are too thin and long.
    """
    distortion = DistortionEnergy(power=2, weight=_PRESSURE if boundary == "free" else 0.0)
    return _minimised(disk, distortion, boundary, gap, rounds)


def conformal(disk: Disk, boundary: Boundary, gap: float) -> Float[ndarray, "vertices 2"]:
    """A one-to-one map that keeps angles: the least-squares conformal map if that is one-to-one.

    If it is not, or if the boundary is not free, the energy of Hormann and Greiner (2000) is minimised instead.

    Raises:
        EmbeddingError: parts of the disk are too thin and long.
    """
    if boundary != "free":  # the negative weight rewards area, so that the chart fills the container
        return _minimised(disk, DistortionEnergy(power=1, weight=-1.0), boundary, gap, _ROUNDS)
    found = _least_squares(disk)
    if found is not None and one_to_one(disk, found):
        return found
    return _minimised(disk, DistortionEnergy(power=1), boundary, gap, _ROUNDS)


def _minimised(
    disk: Disk, distortion: DistortionEnergy, boundary: Boundary, gap: float, rounds: int
) -> Float[ndarray, "vertices 2"]:
    triangles = RestTriangles.of(disk.positions, disk.faces)
    border, shares, initial = disk.border, _shares(disk), tutte(disk)
    container = BoundaryBarrier("disk" if boundary == "disk" else "square", border, shares, _STIFFNESS)
    collision = SelfCollisionBarrier(border, shares, initial[border], max(2.0 * gap, _LEAST_GAP), _STIFFNESS)
    objective = Objective(triangles, distortion, container, collision)
    if not objective.value(initial) < _HOPELESS:
        raise EmbeddingError(TOO_THIN)
    return minimise(objective, initial, rounds, _TOLERANCE)


def _least_squares(disk: Disk) -> Float[ndarray, "vertices 2"] | None:
    """The least-squares conformal map with the border's foremost and rearmost vertex fixed; None if libigl fails."""
    pins = disk.border[np.argsort(-disk.positions[disk.border, 2], kind="stable")[[0, -1]]]
    try:
        found = igl.lscm(disk.positions, disk.faces, pins, np.array([[0.0, -0.5], [0.0, 0.5]]))[0]
    except RuntimeError:
        return None
    return _turned(disk, np.asarray(found)) if np.isfinite(found).all() else None


def _turned(disk: Disk, uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, "vertices 2"]:
    """The map rotated so that its border fits that of Tutte's map best, which fixes the vehicle's orientation."""
    wanted, found = (x[disk.border] @ (1.0, 1.0j) for x in (tutte(disk), uv - uv[disk.border].mean(axis=0)))
    turn = np.angle((_shares(disk) * wanted * found.conj()).sum())
    cos, sin = np.cos(turn), np.sin(turn)
    return np.asarray(uv @ np.array([[cos, sin], [-sin, cos]]))


def one_to_one(disk: Disk, uv: Float[ndarray, "vertices 2"]) -> bool:
    """Whether no triangle is flipped and the border does not cross itself; then no triangle overlaps another."""
    det = RestTriangles.of(disk.positions, disk.faces).determinants(uv)
    return bool((det > 0.0).all()) and not loop_crosses_itself(uv[disk.border])


def _shares(disk: Disk) -> Float[ndarray, " loop"]:
    """The share of the border's length in space that each border vertex represents; the sum is one."""
    points = disk.positions[disk.border]
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    share = length + np.roll(length, 1)
    return np.asarray(share / share.sum())


def packed(uv: Float[ndarray, "vertices 2"], margin: float) -> Float[ndarray, "vertices 2"]:
    """The map moved, and scaled along u and v independently, to fill [margin, 1 - margin]^2."""
    low, high = uv.min(axis=0), uv.max(axis=0)
    return np.asarray(0.5 + (uv - (low + high) / 2) / (high - low) * (1.0 - 2.0 * margin))
