"""Ambient-occlusion visibility and mean curvature of a surface at each of many points.

Both work on a cloud of points spread evenly over the triangles, so that open shells, non-manifold edges, hidden
interiors and triangles of any shape do no harm. NumPy; a second or two for 65,000 points and 30,000 faces.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.spatial import cKDTree

from svbrdfgan.geometry.normals import face_areas, unit
from svbrdfgan.geometry.sampling import faces_by_area, points_in_triangle, upper_frames
from svbrdfgan.types import Surface

_GRID = 128  # cells of a depth map, over the diameter of the surface's bounding sphere
_AXES = 32  # each is looked along both ways


def scatter(
    surface: Surface, spacing: float, faces: Bool[ndarray, " faces"] | None = None
) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"]]:
    """Points about `spacing` metres apart over the faces chosen (all by default), and their unit shading normals.

    Their number depends on the area alone, not on how it is cut into faces. Even, and without randomness.
    """
    corners = surface.faces if faces is None else surface.faces[faces]
    total = np.cumsum(face_areas(surface.positions, corners))
    owner = faces_by_area(total, max(1, round(total[-1] / spacing**2)))
    weights = points_in_triangle(np.arange(len(owner)) - np.searchsorted(owner, owner))
    points = np.einsum("pk,pki->pi", weights, surface.positions[corners[owner]])
    return points, unit(np.einsum("pk,pki->pi", weights, surface.normals[corners[owner]]))


def ambient_visibility(
    surface: Surface, points: Float[ndarray, "points 3"], normals: Float[ndarray, "points 3"]
) -> Float[ndarray, " points"]:
    """What ambient-occlusion maps store (accessibility), at each point: 1 is unoccluded, 0 enclosed.

    The cosine-weighted share of the hemisphere about the normal that the surface leaves free. Orthographic depth maps
    from 64 directions decide what is hidden, softly, so that it varies smoothly; gaps under 2 % of the model's size are
    not seen.
    """
    low, high = surface.positions[surface.faces].min(axis=(0, 1)), surface.positions[surface.faces].max(axis=(0, 1))
    centre, radius = (low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, 1e-12)
    cell = 2.0 / _GRID
    occluders = ((scatter(surface, 0.6 * cell * radius)[0] - centre) / radius).astype(np.float32)
    # above the surface by more than a cell, or its own depth map would shade it
    lifted = ((points - centre) / radius + 1.5 * cell * normals).astype(np.float32)
    free, total = np.zeros(len(points)), np.full(len(points), 1e-12)
    for frame in upper_frames(np.arange(_AXES)).astype(np.float32):
        cosine = np.einsum("pi,i->p", normals, frame[2])
        clearance = _clearance(_turn(occluders, frame), _turn(lifted, frame), cosine < 0.0)
        free += np.abs(cosine) * np.clip(clearance / (2.0 * cell) + 1.5, 0.0, 1.0)
        total += np.abs(cosine)
    return free / total


def mean_curvature(
    surface: Surface, points: Float[ndarray, "points 3"], normals: Float[ndarray, "points 3"], radius: float
) -> Float[ndarray, " points"]:
    """Mean curvature over a ball of `radius` metres, times `radius`: positive on edges, negative in creases.

    The least-squares slope of normal against position over the neighbourhood: on a sphere of radius R exactly
    radius / R, on a plane zero. Neighbours that face away, such as the other side of a sheet, and hidden parts do not
    count.
    """
    hidden = np.array([part.hidden for part in surface.parts])[surface.face_part]
    cloud, facing = scatter(surface, radius / 3.0, None if hidden.all() else ~hidden)
    distance, index = cKDTree(cloud).query(points, k=min(48, len(cloud)), distance_upper_bound=radius, workers=-1)
    found = np.isfinite(distance)
    index = np.where(found, index, 0)
    ray, turn = cloud[index] - points[:, None], facing[index] - normals[:, None]
    agreement = 1.0 - 0.5 * np.square(turn).sum(axis=2)
    # smooth to zero at the radius, and for normals that face away: no neighbour enters or leaves with a jump
    weight = np.where(found, 1.0 - (distance / radius) ** 2, 0.0) * np.clip(1.0 + 2.0 * agreement, 0.0, 1.0)
    slope = (weight * (turn * ray).sum(axis=2)).sum(axis=1)
    spread = (weight * np.square(ray).sum(axis=2)).sum(axis=1)
    return radius * slope / np.maximum(spread, 1e-6 * radius**2)


def _clearance(
    occluders: Float[ndarray, "occluders 3"], points: Float[ndarray, "points 3"], backward: Bool[ndarray, " points"]
) -> Float[ndarray, " points"]:
    """How far each point lies in front of what is seen along the third axis, or against it where `backward`.

    Interpolated between the four nearest cells of the depth map; where there is nothing to see, 1.
    """
    depth = np.full((2, _GRID * _GRID), -1.0e3, dtype=np.float32)
    cells = _cells(np.floor((occluders[:, :2] + 1.0) * (_GRID / 2.0)).astype(np.int64))
    np.maximum.at(depth[0], cells, occluders[:, 2])
    np.maximum.at(depth[1], cells, -occluders[:, 2])
    place = (points[:, :2] + 1.0) * (_GRID / 2.0) - 0.5
    corner = np.floor(place).astype(np.int64)
    part = place - corner
    mine, table = np.where(backward, -points[:, 2], points[:, 2]), depth.reshape(-1)
    base, total = backward * _GRID * _GRID, np.zeros(len(points))
    limit = 4.0 / _GRID
    for i in (0, 1):
        for j in (0, 1):
            weight = np.abs(1 - i - part[:, 0]) * np.abs(1 - j - part[:, 1])
            gap = mine - table[base + _cells(corner + np.array([i, j]))]
            total += weight * np.clip(gap, -2.0 * limit, limit)
    return total


def _turn(points: Float[ndarray, "points 3"], frame: Float[ndarray, "3 3"]) -> Float[ndarray, "points 3"]:
    """Coordinates along the frame's rows. Not by BLAS, whose threads cost more than they save on three columns."""
    return np.einsum("pi,ki->pk", points, frame)


def _cells(index: Int[ndarray, "points 2"]) -> Int[ndarray, " points"]:
    inside = np.clip(index, 0, _GRID - 1)
    return inside[:, 0] * _GRID + inside[:, 1]
