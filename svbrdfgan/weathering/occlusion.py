"""Ambient-occlusion visibility and mean curvature of a surface at given points.

Both use a point cloud that is spread evenly over the triangles. So they are robust to open shells, non-manifold edges,
hidden interiors and badly shaped triangles. Both take one to two seconds for 65,000 points and 30,000 faces.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.spatial import cKDTree

from svbrdfgan.geometry.normals import face_areas, unit
from svbrdfgan.geometry.sampling import faces_by_area, points_in_triangle, upper_frames
from svbrdfgan.types import Surface
from svbrdfgan.utils.threads import by_blocks, in_threads

_GRID = 128  # cells along a side of a depth map, which spans the diameter of the bounding sphere
_MOST = 2_000_000  # points: several times what vehicles with all their seats need
_AXES = 32  # each is used in both directions


def scatter(
    surface: Surface, spacing: float, faces: Bool[ndarray, " faces"] | None = None
) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"]]:
    """Points about `spacing` metres apart on the faces in the mask (default: all), and their unit shading normals.

    The number of points depends only on the area, not on the tessellation, and is `_MOST` at most: then they are
    further apart. Points are evenly spread and deterministic.
    """
    corners = surface.faces if faces is None else surface.faces[faces]
    total = np.cumsum(face_areas(surface.positions, corners))
    owner = faces_by_area(total, min(max(1, round(total[-1] / spacing**2)), _MOST))
    weights = points_in_triangle(np.arange(len(owner)) - np.searchsorted(owner, owner))
    points = np.einsum("pk,pki->pi", weights, surface.positions[corners[owner]])
    return points, unit(np.einsum("pk,pki->pi", weights, surface.normals[corners[owner]]))


def ambient_visibility(
    surface: Surface, points: Float[ndarray, "points 3"], normals: Float[ndarray, "points 3"]
) -> Float[ndarray, " points"]:
    """Ambient-occlusion visibility (accessibility) at each point: 1 is unoccluded, 0 is enclosed.

    Visibility is the cosine-weighted share of the hemisphere around the normal that the surface does not occlude,
    computed from orthographic depth maps in 64 directions, with a soft comparison so that it varies smoothly. Gaps
    smaller than 2 % of the model's size are not resolved.
    """
    low, high = surface.positions[surface.faces].min(axis=(0, 1)), surface.positions[surface.faces].max(axis=(0, 1))
    centre, radius = (low + high) / 2.0, max(float(np.linalg.norm(high - low)) / 2.0, 1e-12)
    cell = 2.0 / _GRID
    occluders = ((scatter(surface, 0.6 * cell * radius)[0] - centre) / radius).astype(np.float32)
    # a bias of more than a cell along the normal: without it the surface would occlude itself
    lifted = ((points - centre) / radius + 1.5 * cell * normals).astype(np.float32)
    free, total = np.zeros(len(points)), np.full(len(points), 1e-12)  # a normal of zero faces no direction

    def along(frame: Float[ndarray, "3 3"]) -> tuple[Float[ndarray, " points"], Float[ndarray, " points"]]:
        cosine = np.einsum("pi,i->p", normals, frame[2])
        clearance = _clearance(_turn(occluders, frame), _turn(lifted, frame), cosine < 0.0)
        return np.abs(cosine), np.clip(clearance / (2.0 * cell) + 1.5, 0.0, 1.0)

    for weight, share in in_threads(along, upper_frames(np.arange(_AXES)).astype(np.float32)):
        free += weight * share
        total += weight
    return free / total


def mean_curvature(
    surface: Surface, points: Float[ndarray, "points 3"], normals: Float[ndarray, "points 3"], radius: float
) -> Float[ndarray, " points"]:
    """Mean curvature times `radius`, over a ball of `radius` metres: positive on edges, negative in creases.

    The result is the least-squares slope of the normal against the position in the neighbourhood: exactly radius / R on
    a sphere of radius R, zero on a plane. Hidden parts are ignored, and so are neighbours that face away, such as the
    other side of a sheet.
    """
    hidden = np.array([part.hidden for part in surface.parts])[surface.face_part]
    cloud, facing = scatter(surface, radius / 3.0, None if hidden.all() else ~hidden)
    tree = cKDTree(cloud)
    nearest = np.arange(min(48, len(cloud))) + 1  # a list, since a number of 1 would drop its axis
    facing_square, facing_along = _dot(facing, facing), _dot(facing, cloud)

    def slope(points: Float[ndarray, "block 3"], normals: Float[ndarray, "block 3"]) -> Float[ndarray, " block"]:
        distance, index = tree.query(points, k=nearest, distance_upper_bound=radius)
        found = np.isfinite(distance)
        index, square = np.where(found, index, 0), np.where(found, np.square(distance), 0.0)
        # with ray = cloud - points and turn = facing - normals: |turn|^2 and turn . ray, multiplied out to be faster
        there = facing[index]
        turn_square = facing_square[index] + _dot(normals, normals)[:, None] - 2.0 * _each(there, normals)
        rise = (
            facing_along[index] - _each(there, points) - _each(cloud[index], normals) + _dot(points, normals)[:, None]
        )
        # the weight falls to zero at the radius and for opposite normals, so the result is continuous in the point
        weight = np.where(found, 1.0 - square / radius**2, 0.0) * np.clip(3.0 - turn_square, 0.0, 1.0)
        return radius * _dot(weight, rise) / np.maximum(_dot(weight, square), 1e-6 * radius**2)

    return by_blocks(slope, points, normals)


def _dot(one: Float[ndarray, "rows n"], other: Float[ndarray, "rows n"]) -> Float[ndarray, " rows"]:
    return np.einsum("pi,pi->p", one, other)


def _each(several: Float[ndarray, "rows k 3"], one: Float[ndarray, "rows 3"]) -> Float[ndarray, "rows k"]:
    """The dot product of each of a row's vectors with the row's one."""
    return np.einsum("pki,pi->pk", several, one)


def _clearance(
    occluders: Float[ndarray, "occluders 3"], points: Float[ndarray, "points 3"], backward: Bool[ndarray, " points"]
) -> Float[ndarray, " points"]:
    """Signed distance of each point in front of the depth map along the third axis (its opposite where `backward`).

    The distance is clipped and interpolated between the four nearest cells of the depth map; empty cells count as
    unoccluded.
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
    """Coordinates along the frame's rows. Not by BLAS: its threads cost more than they save on three columns."""
    return np.einsum("pi,ki->pk", points, frame)


def _cells(index: Int[ndarray, "points 2"]) -> Int[ndarray, " points"]:
    """Flat depth-map index of each (row, column), clamped to the border."""
    inside = np.clip(index, 0, _GRID - 1)
    return inside[:, 0] * _GRID + inside[:, 1]
