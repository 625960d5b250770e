"""Rays against every triangle of a surface in turn: camera hits and shadows, through parts that are not opaque."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.testing.lookups import at_uv
from svbrdfgan.types import Surface, View

_EDGE = 1e-9
"""Triangles reach this far beyond their edges, in barycentrics, so that no ray slips between two."""

_SAME = 1e-9
"""Two hits of one part that lie so close together are one, on an edge that two triangles share. Metres."""


@dataclass(frozen=True, eq=False)
class Points:
    """Camera hits: one point for each ray and each part that it meets on its way, up to the first that is opaque.

    Attributes:
        weight: the share of the ray that ends at the point: 1, unless something is not opaque.
        normal: the interpolated shading normal, turned to the viewer.
        tangent, bitangent: the directions of a normal map's x and y, turned over together with the normal.
    """

    pixel: Int[ndarray, " points"]
    weight: Float[ndarray, " points"]
    part: Int[ndarray, " points"]
    uv: Float[ndarray, "points 2"]
    position: Float[ndarray, "points 3"]
    normal: Float[ndarray, "points 3"]
    tangent: Float[ndarray, "points 3"]
    bitangent: Float[ndarray, "points 3"]
    to_viewer: Float[ndarray, "points 3"]

    def at(self, some: slice | Bool[ndarray, " points"]) -> Points:
        """The points that `some` selects."""
        return Points(*(getattr(self, field.name)[some] for field in fields(self)))


def seen(surface: Surface, view: View, grid: int) -> Points:
    """The points where a grid of rays in each pixel meets the surface."""
    direction = _camera_directions(view, grid)
    ray, weight, face, at = _met(surface, np.array([view.camera.origin]), direction)
    to_viewer, corner = -direction[ray], surface.faces[face]
    tangents = corner_tangents(surface)
    normal = _unit((surface.normals[corner] * at).sum(axis=1))
    along_u = (tangents.direction[face] * at).sum(axis=1)
    tangent = _unit(along_u - (along_u * normal).sum(axis=1, keepdims=True) * normal)
    bitangent = tangents.handedness[face, None] * np.cross(normal, tangent)
    side = np.where((normal * to_viewer).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    row, col = np.divmod(ray, view.width * grid)
    pixel = row // grid * view.width + col // grid
    uv, position = ((values[corner] * at).sum(axis=1) for values in (surface.uv, surface.positions))
    frame = side * normal, side * tangent, side * bitangent
    return Points(pixel, weight, surface.face_part[face], uv, position, *frame, to_viewer)


def passing(
    position: Float[ndarray, "points 3"], direction: Float[ndarray, "cells 3"], surface: Surface
) -> Float[ndarray, "points cells"]:
    """The share of light that arrives at each point along each direction: 0 or 1, unless something is not opaque."""
    passes, before = np.ones((len(position), len(direction))), dict[int, list[ndarray]]()
    for corners, part, uv in zip(
        surface.positions[surface.faces], surface.face_part, surface.uv[surface.faces], strict=True
    ):
        a, b, c = corners
        if abs((position - a) @ np.cross(b - a, c - a)).max(initial=0.0) < 1e-12:
            continue  # the points lie in its plane, where it shadows nothing
        distance, u, v = _crossings(position, direction, corners)
        hit = np.isfinite(distance)
        if surface.parts[part].opaque:
            passes[hit] = 0.0
            continue
        for other in before.setdefault(part, []):
            hit &= ~(abs(distance - other) < _SAME)
        before[part].append(np.where(np.isfinite(distance), distance, 1e30))  # finite, so that differences are numbers
        at = np.stack([1.0 - u[hit] - v[hit], u[hit], v[hit]], axis=-1)
        passes[hit] *= 1.0 - _alpha(surface, np.full(len(at), part), at @ uv)
    return passes


def _camera_directions(view: View, grid: int) -> Float[ndarray, "rays 3"]:
    """Unit directions through the film, row by row, `grid` rows and columns in each pixel."""
    right, top, backward = view.camera.basis()
    half = np.tan(view.camera.vertical_fov / 2.0)
    y, x = np.indices((view.height * grid, view.width * grid)).reshape(2, -1) + 0.5
    across = half * (2.0 * x / grid - view.width) / view.height
    up = half * (1.0 - 2.0 * y / grid / view.height)
    return _unit(across[:, None] * right + up[:, None] * top - backward)


def _met(
    surface: Surface, origin: Float[ndarray, "1 3"], direction: Float[ndarray, "rays 3"]
) -> tuple[Int[ndarray, " hits"], Float[ndarray, " hits"], Int[ndarray, " hits"], Float[ndarray, "hits 3 1"]]:
    """The hits that light comes from: their ray, their share of it, their face, and barycentrics."""
    found = [_crossings(origin, direction, corners) for corners in surface.positions[surface.faces]]
    distances, u, v = (np.concatenate(each) for each in zip(*found, strict=True))  # (faces, rays)
    order = np.argsort(distances, axis=0).T
    near = np.take_along_axis(distances.T, order, axis=1)
    ray, place = np.nonzero(np.isfinite(near))
    face, distance = order[ray, place], near[ray, place]
    at = np.stack([1.0 - u - v, u, v], axis=-1)[face, ray]
    part, uv = surface.face_part[face], (surface.uv[surface.faces[face]] * at[..., None]).sum(axis=1)
    weight = _shares(ray, distance, part, _alpha(surface, part, uv))
    ends = weight > 0.0
    return ray[ends], weight[ends], face[ends], at[ends, :, None]


def _shares(
    ray: Int[ndarray, " hits"],
    distance: Float[ndarray, " hits"],
    part: Int[ndarray, " hits"],
    alpha: Float[ndarray, " hits"],
) -> Float[ndarray, " hits"]:
    """The share of each ray that ends at each of its hits, which come in order."""
    shares, left, last = np.zeros(len(ray)), 1.0, dict[int, float]()
    for hit in range(len(ray)):
        if hit == 0 or ray[hit] != ray[hit - 1]:
            left, last = 1.0, {}
        owner, way = int(part[hit]), float(distance[hit])
        if way - last.get(owner, -np.inf) > _SAME:
            shares[hit], left = left * alpha[hit], left * (1.0 - float(alpha[hit]))
        last[owner] = way
    return shares


def _alpha(
    surface: Surface, part: Int[ndarray, " points"], uv: Float[ndarray, "points 2"]
) -> Float[ndarray, " points"]:
    """The parts' alpha at points on them."""
    alpha = np.ones(len(part))
    for number, owner in enumerate(surface.parts):
        mine, value = part == number, np.atleast_2d(np.asarray(owner.alpha, dtype=np.float64))
        if not owner.opaque:
            alpha[mine] = at_uv(value, uv[mine], surface.repeat)
    return alpha


def _unit(vectors: Float[ndarray, "n 3"]) -> Float[ndarray, "n 3"]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))


def _crossings(
    origin: Float[ndarray, "n 3"], direction: Float[ndarray, "m 3"], corners: Float[ndarray, "3 3"]
) -> tuple[Float[ndarray, "n m"], Float[ndarray, "n m"], Float[ndarray, "n m"]]:
    """The distance from each origin along each direction to a triangle, infinite for a miss; and u and v there.

    The solution of origin + t d = a + u (b - a) + v (c - a) by Cramer's rule (Möller and Trumbore 1997).
    """
    a, b, c = corners
    side, other, start = b - a, c - a, origin - a
    across, moment = np.cross(direction, other), np.cross(start, side)
    determinant = across @ side
    inverse = np.divide(1.0, determinant, out=np.full(len(direction), np.nan), where=abs(determinant) > 1e-12)
    u, v, distance = (start @ across.T) * inverse, (moment @ direction.T) * inverse, (moment @ other)[:, None] * inverse
    inside = (u >= -_EDGE) & (v >= -_EDGE) & (u + v <= 1.0 + _EDGE) & (distance > 1e-6)
    return np.where(inside, distance, np.inf), u, v
