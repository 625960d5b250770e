"""Locates points of a mesh on the surface that an embedding made of it, for any subdivision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import face_areas
from svbrdfgan.types import Mesh, Surface


@dataclass(frozen=True, eq=False)
class Points:
    """Points on a mesh, by face and barycentric coordinates."""

    face: Int[ndarray, " points"]
    barycentric: Float[ndarray, "points 3"]

    @classmethod
    def on_every_face(cls, mesh: Mesh, each: int) -> Points:
        """`each` random points on every face that has an area, the same at every call; none lies on an edge."""
        face = np.repeat(np.flatnonzero(face_areas(mesh.positions, mesh.faces) > 0.0), each)
        return cls(face, np.random.default_rng(0).dirichlet(np.ones(3), len(face)))


@dataclass(frozen=True, eq=False)
class Found:
    """Points on a surface.

    Attributes:
        pieces: how many faces of the surface hold each point.
        uv: UV of each point, by the last piece that holds it; zero if no piece does.
    """

    pieces: Int[ndarray, " points"]
    uv: Float[ndarray, "points 2"]


def find(surface: Surface, points: Points) -> Found:
    """Locates the points on the surface."""
    order = np.argsort(surface.source_face, kind="stable")
    first = np.searchsorted(surface.source_face[order], points.face, side="left")
    count = np.searchsorted(surface.source_face[order], points.face, side="right") - first
    point = np.repeat(np.arange(len(points.face)), count)
    step = np.arange(len(point)) - np.repeat(np.cumsum(count) - count, count)
    piece = order[first[point] + step]
    weights = _within(surface.source_barycentric[piece], points.barycentric[point])
    inside = weights.min(axis=1) >= 0.0
    uv = np.zeros((len(points.face), 2))
    uv[point[inside]] = np.einsum("pk,pkx->px", weights[inside], surface.uv[surface.faces[piece[inside]]])
    return Found(np.bincount(point[inside], minlength=len(points.face)), uv)


def _within(corners: Float[ndarray, "pairs 3 3"], point: Float[ndarray, "pairs 3"]) -> Float[ndarray, "pairs 3"]:
    """Barycentric coordinates of points in pieces, both given in the source face; -1 in a piece without area."""
    facing = np.cross(np.roll(corners, -1, axis=1), np.roll(corners, -2, axis=1))
    area = np.einsum("px,px->p", corners[:, 0], facing[:, 0])
    good = np.abs(area) > 1e-14
    return np.where(good[:, None], np.einsum("pkx,px->pk", facing, point) / np.where(good, area, 1.0)[:, None], -1.0)
