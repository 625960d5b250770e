"""The boundary barrier: a logarithmic barrier that keeps a chart's border inside a square or a disk."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

Shape = Literal["square", "disk"]
_SQUARE = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])  # inward normals of the square [-0.5, 0.5]^2


@dataclass(frozen=True, eq=False)
class BoundaryBarrier:
    """-stiffness * sum of weight * log(distance to a wall of the container), over a chart's border about the origin.

    Attributes:
        shape: square of side one, or disk of diameter one.
        border: the vertices around the chart.
        weight: share of the border's length that each vertex represents.
        stiffness: at rest the border stays about a quarter of this away from the walls.
    """

    shape: Shape
    border: Int[ndarray, " loop"]
    weight: Float[ndarray, " loop"]
    stiffness: float

    def value(self, uv: Float[ndarray, "vertices 2"]) -> float:
        """The cost; infinite if a vertex lies on or beyond a wall."""
        gap, _ = self._gaps(uv[self.border])
        if not (gap > 0.0).all():
            return float("inf")
        return float(-self.stiffness * (self.weight[:, None] * np.log(gap)).sum())

    def derivatives(
        self, uv: Float[ndarray, "vertices 2"]
    ) -> tuple[Float[ndarray, "loop 2"], Float[ndarray, "loop 2 2"]]:
        """Gradient and positive semidefinite Hessian at each border vertex."""
        gap, inward = self._gaps(uv[self.border])
        scale = self.stiffness * self.weight[:, None] / gap
        gradient = -np.einsum("bw,bwx->bx", scale, inward)
        hessian = np.einsum("bw,bwx,bwy->bxy", scale / gap, inward, inward)
        if self.shape == "disk":  # its gap is quadratic in the position, which adds a second derivative
            hessian += 2.0 * scale[:, :, None] * np.eye(2)
        return gradient, hessian

    def _gaps(self, points: Float[ndarray, "n 2"]) -> tuple[Float[ndarray, "n walls"], Float[ndarray, "n walls 2"]]:
        """A function for each wall that is positive inside, and its gradient; for the disk, 1/4 - |x|^2."""
        if self.shape == "square":
            return 0.5 + points @ _SQUARE.T, np.broadcast_to(_SQUARE, (len(points), 4, 2))
        return (0.25 - (points**2).sum(axis=1))[:, None], -2.0 * points[:, None, :]
