"""Tangent frames of normal maps, by the rule of `docs/conventions.md`, so that all renderers and files share them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import corner_angles, unit, uv_areas
from svbrdfgan.types import Surface


@dataclass(frozen=True, eq=False)
class Tangents:
    """The tangents of a surface's faces, as glTF's TANGENT attribute has them: (direction, handedness).

    Attributes:
        direction: unit tangents at face corners, along growing u and perpendicular to the corner's normal.
        handedness: 1.0, or -1.0 for faces with mirrored UVs. The bitangent is handedness * cross(normal, tangent).
    """

    direction: Float[ndarray, "faces 3 3"]
    handedness: Float[ndarray, " faces"]

    def frames(
        self,
        normals: Float[ndarray, "faces 3 3"],
        face: Int[ndarray, " points"],
        barycentric: Float[ndarray, "points 3"],
    ) -> tuple[Float[ndarray, "points 3"], Float[ndarray, "points 3"], Float[ndarray, "points 3"]]:
        """Unit tangents, bitangents and normals at points of the faces, whose corners have these normals."""
        weights = barycentric[:, :, None]
        normal = unit((normals[face] * weights).sum(axis=1))
        tangent = unit(_perpendicular((self.direction[face] * weights).sum(axis=1), normal))
        return tangent, self.handedness[face, None] * np.cross(normal, tangent), normal

    def attribute(self) -> Float[ndarray, "faces 3 4"]:
        """glTF's TANGENT at face corners: direction and handedness."""
        hand = np.broadcast_to(self.handedness[:, None, None], (*self.direction.shape[:2], 1))
        return np.concatenate([self.direction, hand], axis=-1)


def corner_tangents(surface: Surface) -> Tangents:
    """The tangents of a surface.

    As MikkTSpace has it (Mikkelsen, "Simulation of Wrinkled Surfaces Revisited", 2008), a corner's tangent is the
    angle-weighted mean of the directions of growing u of the faces that share its vertex and handedness, each projected
    onto the vertex's tangent plane. A face without area in UV has no such direction: it takes its vertices' tangents,
    right-handed if there are both; where a vertex has none, any direction perpendicular to its normal serves.
    """
    faces, normals = surface.faces, surface.normals[surface.faces]
    uv = (surface.uv if surface.whole_uv is None else surface.whole_uv)[faces]
    area = uv_areas(uv)
    has_area = abs(area) > 1e-30
    handedness = np.where(has_area & (area < 0.0), -1.0, 1.0)
    along_u = _along_u(surface.positions[faces], uv) * handedness[:, None]
    projected = unit(_perpendicular(np.broadcast_to(along_u[:, None], normals.shape), normals), np.zeros(3))
    weighted = projected * (corner_angles(surface.positions, faces) * has_area[:, None])[..., None]

    vertices = len(surface.positions)
    mirrored = (handedness < 0.0).astype(np.int64)
    slots = _sum_by(faces + vertices * mirrored[:, None], weighted, 2 * vertices)
    known = np.linalg.norm(slots, axis=1) > 1e-12
    # only faces without area can lack a tangent of their own handedness
    left_only = ~has_area & (~known[faces] & known[faces + vertices]).any(axis=1) & ~known[faces].any(axis=1)
    mirrored[left_only], handedness[left_only] = 1, -1.0
    tangent = slots[faces + vertices * mirrored[:, None]]
    return Tangents(unit(_perpendicular(tangent, normals), _any_perpendicular(normals)), handedness)


def _along_u(positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, "faces 3"]:
    """dP/du times twice the signed area in UV: its direction is right for right-handed faces."""
    edges, dv = positions[:, 1:] - positions[:, :1], uv[:, 1:, 1:] - uv[:, :1, 1:]
    return dv[:, 1] * edges[:, 0] - dv[:, 0] * edges[:, 1]


def _perpendicular(vectors: Float[ndarray, "*n 3"], normals: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    return vectors - (vectors * normals).sum(axis=-1, keepdims=True) * normals


def _any_perpendicular(normals: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 3"]:
    """Unit vectors perpendicular to each normal: of the axis that it has least of, what is perpendicular to it."""
    axis = np.eye(3)[abs(normals).argmin(axis=-1)]
    return unit(_perpendicular(axis, normals))


def _sum_by(slot: Int[ndarray, "faces 3"], values: Float[ndarray, "faces 3 3"], slots: int) -> Float[ndarray, "_ 3"]:
    flat = values.reshape(-1, 3)
    return np.stack([np.bincount(slot.ravel(), flat[:, axis], slots) for axis in range(3)], axis=-1)
