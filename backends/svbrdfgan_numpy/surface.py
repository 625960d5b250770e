"""The prepared surface, and the points where rays meet it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.geometry.tangents import Tangents, corner_tangents
from svbrdfgan.types import Surface
from svbrdfgan_numpy.bvh import Bvh, Hits, build
from svbrdfgan_numpy.normal_map import Frame
from svbrdfgan_numpy.transparency import Transparency
from svbrdfgan_numpy.vectors import cross, dot, normalize, tangents

OFFSET = 1e-9
"""Distance from the surface at which a leaving ray starts, in diagonals of the scene: above float64's rounding."""


@dataclass(frozen=True, eq=False)
class PreparedSurface:
    """A surface with its search tree.

    Attributes:
        offset: distance from the surface at which a leaving ray starts, metres.
        transparency: by which rays pass through; None if every part is opaque.
    """

    surface: Surface
    bvh: Bvh
    offset: float
    transparency: Transparency | None

    @cached_property
    def tangents(self) -> Tangents:
        """The tangents of the surface's faces, computed when a normal map first needs them."""
        return corner_tangents(self.surface)


@dataclass(frozen=True, eq=False)
class Points:
    """Points where rays meet the surface.

    Attributes:
        position: in metres.
        outgoing: unit direction back along the ray.
        normal: unit shading normal, turned to the ray's side.
        geometric: unit normal of the face, on either side of it.
        side: 1.0, or -1.0 where the shading normal had to be turned.
        face: index of the face.
        barycentric: of its three corners.
        part: index into the surface's parts.
        uv: texture coordinates.
    """

    position: Float[ndarray, "points 3"]
    outgoing: Float[ndarray, "points 3"]
    normal: Float[ndarray, "points 3"]
    geometric: Float[ndarray, "points 3"]
    side: Float[ndarray, " points"]
    face: Int[ndarray, " points"]
    barycentric: Float[ndarray, "points 3"]
    part: Int[ndarray, " points"]
    uv: Float[ndarray, "points 2"]

    def leave(self, direction: Float[ndarray, "points 3"], offset: float) -> Float[ndarray, "points 3"]:
        """Origins of rays from the points, moved along the geometric normal to the side that the ray goes to."""
        side = np.where(dot(self.geometric, direction) < 0.0, -offset, offset)
        return self.position + side[:, None] * self.geometric


def prepare(surface: Surface) -> PreparedSurface:
    """The surface with its search tree."""
    corners = surface.positions[surface.faces]
    size = np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0))
    return PreparedSurface(surface, build(corners), OFFSET * float(size), Transparency.of(surface))


def points_at(prepared: PreparedSurface, hits: Hits, direction: Float[ndarray, "rays 3"]) -> Points:
    """The points of those rays that hit the surface."""
    surface, found = prepared.surface, hits.found
    face, direction = hits.face[found], direction[found]
    vertices = surface.faces[face]
    second, third = hits.barycentric[found].T
    barycentric = np.stack([1.0 - second - third, second, third], axis=-1)
    position, normal, uv = (
        np.einsum("pk,pkc->pc", barycentric, values[vertices])
        for values in (surface.positions, surface.normals, surface.uv)
    )
    first, second, third = np.moveaxis(surface.positions[vertices], 1, 0)
    geometric = normalize(cross(second - first, third - first), fallback=normal)
    normal = normalize(normal, fallback=geometric)
    side = np.where(dot(normal, direction) > 0.0, -1.0, 1.0)
    normal, part = side[:, None] * normal, surface.face_part[face]
    return Points(position, -direction, normal, geometric, side, face, barycentric, part, uv)


def frames_at(prepared: PreparedSurface, points: Points, some: Int[ndarray, " some"]) -> Frame:
    """The tangent frames of some of the points, turned to the viewer as their normals are."""
    if not len(some):
        return Frame(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    normal, side, face = points.normal[some], points.side[some, None], points.face[some]
    tangent = np.einsum("pk,pkc->pc", points.barycentric[some], prepared.tangents.direction[face])
    tangent = tangent - dot(tangent, normal)[:, None] * normal
    tangent = side * normalize(tangent, fallback=tangents(normal)[0])
    # Of the turned N and T, the product is not turned: it takes the sign on its own.
    bitangent = side * prepared.tangents.handedness[face, None] * cross(normal, tangent)
    return Frame(np.stack([tangent, bitangent, normal], axis=1), points.outgoing[some])
