"""Where rays meet triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan_numpy.vectors import cross, dot


@dataclass(frozen=True, eq=False)
class Hits:
    """What each ray has met so far; the arrays are filled in place while a search goes on.

    Attributes:
        face: index of the face, -1 for none.
        distance: in lengths of the ray's direction, infinite for none.
        barycentric: of the second and third corner.
    """

    face: Int[ndarray, " rays"]
    distance: Float[ndarray, " rays"]
    barycentric: Float[ndarray, "rays 2"]

    @classmethod
    def none(cls, rays: int) -> Hits:
        return cls(np.full(rays, -1, dtype=np.int64), np.full(rays, np.inf), np.zeros((rays, 2)))

    @property
    def found(self) -> Bool[ndarray, " rays"]:
        return self.face >= 0

    def keep_nearer(
        self,
        ray: Int[ndarray, " tries"],
        face: Int[ndarray, " tries"],
        distance: Float[ndarray, " tries"],
        barycentric: Float[ndarray, "tries 2"],
    ) -> None:
        """Note the tries nearer than what their ray had, no ray named twice. Of equally near faces the first stays."""
        tie = (distance == self.distance[ray]) & (face < self.face[ray])
        nearer = (distance < self.distance[ray]) | tie
        self.face[ray[nearer]] = face[nearer]
        self.distance[ray[nearer]] = distance[nearer]
        self.barycentric[ray[nearer]] = barycentric[nearer]


def intersect(
    corners: Float[ndarray, "pairs 3 3"], origin: Float[ndarray, "pairs 3"], direction: Float[ndarray, "pairs 3"]
) -> tuple[Float[ndarray, " pairs"], Float[ndarray, "pairs 2"]]:
    """Distance and barycentrics where each ray meets its triangle, infinite where it does not.

    From either side, edges included (Möller and Trumbore 1997).
    """
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = cross(direction, edge2)
    determinant = dot(edge1, p)
    inverse = 1.0 / np.where(determinant == 0.0, np.inf, determinant)
    s = origin - corners[:, 0]
    q = cross(s, edge1)
    u, v, distance = dot(s, p) * inverse, dot(direction, q) * inverse, dot(edge2, q) * inverse
    meets = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    return np.where(meets, distance, np.inf), np.stack([u, v], axis=-1)
