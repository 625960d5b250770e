"""Rays against every triangle of a surface in turn: camera hits and shadows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import Surface, View

_EDGE = 1e-9
"""Triangles reach this far beyond their edges, in barycentrics, so that no ray slips between two."""


@dataclass(frozen=True, eq=False)
class Points:
    """Camera hits: one point for each ray that meets the surface, with the normal turned to the viewer."""

    pixel: Int[ndarray, " points"]
    part: Int[ndarray, " points"]
    uv: Float[ndarray, "points 2"]
    position: Float[ndarray, "points 3"]
    normal: Float[ndarray, "points 3"]
    to_viewer: Float[ndarray, "points 3"]


def seen(surface: Surface, view: View, grid: int) -> Points:
    """Where a grid of rays in each pixel meets the surface first."""
    right, top, backward = view.camera.basis()
    half = np.tan(view.camera.vertical_fov / 2.0)
    y, x = np.indices((view.height * grid, view.width * grid)).reshape(2, -1) + 0.5
    across = half * (2.0 * x / grid - view.width) / view.height
    up = half * (1.0 - 2.0 * y / grid / view.height)
    direction = across[:, None] * right + up[:, None] * top - backward
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    origin = np.array([view.camera.origin])
    nearest, face, at = np.full(len(x), np.inf), np.zeros(len(x), dtype=int), np.zeros((len(x), 3))
    for number, corners in enumerate(surface.positions[surface.faces]):
        distance, u, v = (found[0] for found in _crossings(origin, direction, corners))
        closer = distance < nearest
        nearest[closer], face[closer] = distance[closer], number
        at[closer] = np.stack([1.0 - u - v, u, v], axis=-1)[closer]
    hit = np.isfinite(nearest)
    face, at, to_viewer, corner = face[hit], at[hit, :, None], -direction[hit], surface.faces[face[hit]]
    normal = (surface.normals[corner] * at).sum(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    normal *= np.where((normal * to_viewer).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    pixel = (y[hit] // grid * view.width + x[hit] // grid).astype(int)
    uv, position = ((values[corner] * at).sum(axis=1) for values in (surface.uv, surface.positions))
    return Points(pixel, surface.face_part[face], uv, position, normal, to_viewer)


def shadowed(
    position: Float[ndarray, "points 3"], direction: Float[ndarray, "cells 3"], surface: Surface
) -> Bool[ndarray, "points cells"]:
    """Whether something of the surface lies along each direction from each point."""
    found = np.zeros((len(position), len(direction)), dtype=bool)
    for corners in surface.positions[surface.faces]:
        a, b, c = corners
        if abs((position - a) @ np.cross(b - a, c - a)).max(initial=0.0) < 1e-12:
            continue  # the points lie in its plane, where it shadows nothing
        found |= np.isfinite(_crossings(position, direction, corners)[0])
    return found


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
