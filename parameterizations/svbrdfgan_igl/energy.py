"""Distortion of a map from triangles in space to the plane: value, gradient and a positive definite Hessian.

A triangle whose map has singular values s1, s2 costs |J|^2 / (2 det^p) + weight * det, per unit of its area. With p = 2
the first term is (1/s1^2 + 1/s2^2) / 2, the square of the L2 stretch of Sander et al. (2001); with p = 1 it is
(s1/s2 + s2/s1) / 2, which is 1 where the map is conformal. Both are infinite where a triangle degenerates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

_COFACTOR = np.array([[0.0, 0, 0, 1], [0, 0, -1, 0], [0, -1, 0, 0], [1, 0, 0, 0]])  # of (xx, xy, yx, yy)
_FLOOR = 1e-9  # of the largest eigenvalue: least eigenvalue of a projected Hessian


@dataclass(frozen=True, eq=False)
class RestTriangles:
    """The areas and gradient operators of triangles in space.

    Attributes:
        faces: vertex indices.
        area: area of each triangle; the sum is one.
        gradient: maps the values at the three corners to the derivatives in the triangle's own plane.
    """

    faces: Int[ndarray, "faces 3"]
    area: Float[ndarray, " faces"]
    gradient: Float[ndarray, "faces 2 3"]

    @classmethod
    def of(cls, positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> RestTriangles:
        """Triangles in any unit, scaled to a total area of one. None may be degenerate."""
        a, b, c = (positions[faces[:, k]] for k in range(3))
        area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
        scale = np.sqrt(area.sum())
        length = np.linalg.norm(b - a, axis=1) / scale
        along = np.einsum("fx,fx->f", b - a, c - a) / scale**2 / length
        height = 2 * area / scale**2 / length
        zero = np.zeros_like(length)
        du = np.stack([-1 / length, 1 / length, zero], axis=1)
        dv = np.stack([(along / length - 1) / height, -along / length / height, 1 / height], axis=1)
        return cls(faces, area / area.sum(), np.stack([du, dv], axis=1))

    def jacobians(self, uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, "faces 2 2"]:
        """Jacobians of the map into the plane: rows are u and v, columns the triangle's own two axes."""
        return np.einsum("fjc,fcx->fxj", self.gradient, uv[self.faces])

    def determinants(self, uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, " faces"]:
        """Area in the plane divided by area in space; negative where a triangle is flipped."""
        jacobian = self.jacobians(uv)
        return jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] * jacobian[:, 1, 0]


@dataclass(frozen=True)
class DistortionEnergy:
    """The cost of a map.

    Attributes:
        power: p; 2 for stretch, 1 for conformality.
        weight: cost of a unit of area in the plane.
    """

    power: int
    weight: float = 0.0

    def value(self, triangles: RestTriangles, uv: Float[ndarray, "vertices 2"]) -> float:
        """The cost; infinite if a triangle is flipped or degenerate."""
        jacobian, det = triangles.jacobians(uv), triangles.determinants(uv)
        if not (det > 0.0).all():
            return float("inf")
        square = 0.5 * np.einsum("fxj,fxj->f", jacobian, jacobian)
        with np.errstate(divide="ignore", over="ignore"):  # a nearly degenerate triangle costs infinity
            return float((triangles.area * (square / det**self.power + self.weight * det)).sum())

    def derivatives(
        self, triangles: RestTriangles, uv: Float[ndarray, "vertices 2"]
    ) -> tuple[Float[ndarray, "faces 6"], Float[ndarray, "faces 6 6"]]:
        """Gradient and projected Hessian of each triangle's cost, by its corners' (u0, v0, u1, v1, u2, v2)."""
        jacobian = triangles.jacobians(uv).reshape(-1, 4)
        cofactor = jacobian @ _COFACTOR
        det = 0.5 * np.einsum("fi,fi->f", jacobian, cofactor)
        square = 0.5 * np.einsum("fi,fi->f", jacobian, jacobian)
        p = self.power
        slope = self.weight - p * square / det ** (p + 1)
        gradient = jacobian / det[:, None] ** p + slope[:, None] * cofactor
        mixed = jacobian[:, :, None] * cofactor[:, None, :]
        hessian = np.eye(4) / det[:, None, None] ** p + slope[:, None, None] * _COFACTOR
        hessian -= (p / det ** (p + 1))[:, None, None] * (mixed + mixed.transpose(0, 2, 1))
        hessian += (p * (p + 1) * square / det ** (p + 2))[:, None, None] * (
            cofactor[:, :, None] * cofactor[:, None, :]
        )
        lift = np.einsum("fjc,xy->fxjcy", triangles.gradient, np.eye(2)).reshape(-1, 4, 6)
        weighted = triangles.area[:, None]
        return (
            np.einsum("fi,fik->fk", gradient, lift) * weighted,
            lift.transpose(0, 2, 1) @ _positive(hessian) @ lift * weighted[..., None],
        )


def _positive(hessian: Float[ndarray, "faces 4 4"]) -> Float[ndarray, "faces 4 4"]:
    """The Hessians with their eigenvalues raised to a positive floor, so that Newton's step descends."""
    value, vector = np.linalg.eigh(hessian)
    value = np.maximum(value, _FLOOR * np.abs(value).max(axis=1, keepdims=True))
    return np.asarray((vector * value[:, None, :]) @ vector.transpose(0, 2, 1))


def stretch(positions: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], uv: Float[ndarray, "v 2"]) -> float:
    """The L2 stretch of Sander et al. 2001, normalised so that 1.0 is isometric; infinite if a triangle is flipped."""
    triangles = RestTriangles.of(positions, faces)
    det = triangles.determinants(uv)
    if not (det > 0.0).all():
        return float("inf")
    return float(np.sqrt((triangles.area * det).sum() * DistortionEnergy(2).value(triangles, uv)))


def squared_stretch(
    positions: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], uv: Float[ndarray, "v 2"]
) -> Float[ndarray, " f"]:
    """The square of each triangle's own L2 stretch, not normalised."""
    triangles = RestTriangles.of(positions, faces)
    jacobian, det = triangles.jacobians(uv), triangles.determinants(uv)
    return np.asarray(0.5 * np.einsum("fxj,fxj->f", jacobian, jacobian) / np.maximum(det * det, 1e-200))
