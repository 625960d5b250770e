"""Points on a mesh, and attributes at them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.types import Mesh


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """Points on the faces of a mesh.

    Attributes:
        face: index into the mesh's faces.
        barycentric: coordinates in that face.
    """

    face: Int[ndarray, " points"]
    barycentric: Float[ndarray, "points 3"]

    def __len__(self) -> int:
        return len(self.face)

    def interpolate(self, corners: Float[ndarray, "faces 3 *k"]) -> Float[ndarray, " points *k"]:
        """Values that are given at the corners of all faces of the mesh."""
        return np.einsum("pj,pj...->p...", self.barycentric, corners[self.face])

    def positions(self, mesh: Mesh) -> Float[ndarray, "points 3"]:
        """Metres, in the mesh's axes."""
        corners = mesh.faces[self.face]
        return np.einsum("pj,pji->pi", self.barycentric, mesh.positions[corners])
