"""Normals tilted by maps: scaled to unit length, placed in the tangent frame, and bent where the viewer needs it.

`docs/conventions.md` has the equations. The frame is turned to the viewer as a whole, so N . w_o >= 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan_numpy.vectors import dot, normalize

Vectors = Float[ndarray, "points 3"]
PerPoint = Float[ndarray, " points"]


@dataclass(frozen=True, eq=False)
class Frame:
    """Orthonormal axes at some points, and where they are seen from.

    Attributes:
        axes: tangent T, bitangent B and shading normal N, in this order.
        outgoing: unit direction w_o to the viewer.
    """

    axes: Float[ndarray, "points 3 3"]
    outgoing: Vectors

    def tilted(self, texel: Vectors) -> Vectors:
        """The unit normals n that the looked-up numbers (x, y, z) stand for."""
        normal = self._unbent(texel)
        return _Bend.of(self, normal).bent(normal)

    def tilted_vjp(self, texel: Vectors, grad: Vectors) -> Vectors:
        """The gradient of sum(tilted * grad) in the looked-up numbers."""
        normal = self._unbent(texel)
        grad_unbent = _Bend.of(self, normal).bent_vjp(normal, grad)
        return _normalize_vjp(texel, np.einsum("pac,pc->pa", self.axes, grad_unbent))

    def _unbent(self, texel: Vectors) -> Vectors:
        unit = normalize(texel, fallback=np.array([0.0, 0.0, 1.0]))
        return np.einsum("pa,pac->pc", unit, self.axes)


@dataclass(frozen=True, eq=False)
class _Bend:
    """The bend of normals: n becomes (n + k w_o) / |n + k w_o| where the mirror direction is below the surface.

    With e = b - 2 a c, k = e / d and d = a + r. Here n + k w_o is scaled by d, which is 0 in the limit of k.

    Attributes:
        frame: of all points.
        a, b, c: n . N, w_o . N and n . w_o.
        e: how far the mirror direction is below the surface; it is bent where e > 0.
        r: sqrt(a^2 + b e), 1 where it is not bent.
    """

    frame: Frame
    a: PerPoint
    b: PerPoint
    c: PerPoint
    e: PerPoint
    r: PerPoint

    @classmethod
    def of(cls, frame: Frame, normal: Vectors) -> _Bend:
        surface, outgoing = frame.axes[:, 2], frame.outgoing
        a, b, c = dot(normal, surface), np.maximum(dot(outgoing, surface), 0.0), dot(normal, outgoing)
        e = b - 2.0 * a * c
        return cls(frame, a, b, c, e, np.sqrt(np.where(e > 0.0, a**2 + b * e, 1.0)))

    def bent(self, normal: Vectors) -> Vectors:
        return np.where((self.e > 0.0)[:, None], normalize(self._sum(normal), fallback=normal), normal)

    def bent_vjp(self, normal: Vectors, grad: Vectors) -> Vectors:
        """The gradient of sum(bent * grad) in n, as if n need not be of unit length."""
        surface, outgoing = self.frame.axes[:, 2], self.frame.outgoing
        grad_sum = _normalize_vjp(self._sum(normal), grad)
        grad_d, slope = dot(grad_sum, normal), 0.5 / np.where(self.r > 0.0, self.r, 1.0)  # slope: of the root
        grad_e = dot(grad_sum, outgoing) + grad_d * slope * self.b
        grad_a = grad_d * (1.0 + slope * 2.0 * self.a) - 2.0 * self.c * grad_e
        grad_c = -2.0 * self.a * grad_e
        through = (self.a + self.r)[:, None] * grad_sum + grad_a[:, None] * surface + grad_c[:, None] * outgoing
        return np.where((self.e > 0.0)[:, None], through, grad)

    def _sum(self, normal: Vectors) -> Vectors:
        """d n + e w_o."""
        return (self.a + self.r)[:, None] * normal + self.e[:, None] * self.frame.outgoing


def _normalize_vjp(vector: Vectors, grad: Vectors) -> Vectors:
    """The gradient of sum(normalize(vector) * grad); 0 for zero vectors."""
    unit, length = normalize(vector, fallback=np.zeros(3)), np.sqrt(dot(vector, vector))[:, None]
    across = grad - dot(unit, grad)[:, None] * unit
    return np.where(length > 0.0, across / np.where(length > 0.0, length, 1.0), 0.0)
