"""Makes room in UV for triangles that the closest-point map collapses (walls upright on the wrap) or mirrors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy import sparse
from scipy.sparse.linalg import splu

_LEAST = 0.6  # least singular value that a triangle's map onto the wrap should have
_COLLAPSED = 0.2  # a triangle whose least singular value is below this counts as collapsed
_TORN = 4.0  # a triangle whose greatest singular value is above this counts as torn
_MOST = 1.5  # greatest singular value that a torn or collapsed triangle is given
_REACH = 0.08  # of the longest side: moving a vertex this far costs as much as an error of one in scale
_ROUNDS = 40
_LEAST_AREA = 1e-10  # of the square of the longest side: smaller triangles count as having no area


@dataclass(frozen=True, eq=False)
class Planes:
    """Triangles, each in two-dimensional coordinates of its own plane.

    Attributes:
        slopes: gradients of the three hat functions; zero for triangles without an area.
        area: areas; zero for triangles below the least area.
    """

    slopes: Float[ndarray, "faces 3 2"]
    area: Float[ndarray, " faces"]

    @classmethod
    def of(cls, corners: Float[ndarray, "faces 3 3"]) -> Planes:
        """The triangles wound counter-clockwise, each with its first edge along the first axis."""
        p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        twice = np.linalg.norm(np.cross(p, q), axis=1)
        good = twice > 2.0 * _LEAST_AREA
        length = np.where(good, np.linalg.norm(p, axis=1), 1.0)
        height = np.where(good, twice, 1.0) / length
        second = np.stack([1.0 / length, -np.einsum("fx,fx->f", p, q) / (length**2 * height)], axis=1)
        third = np.stack([np.zeros(len(p)), 1.0 / height], axis=1)
        slopes = np.stack([-second - third, second, third], axis=1)
        return cls(np.where(good[:, None, None], slopes, 0.0), np.where(good, 0.5 * twice, 0.0))

    @property
    def edges(self) -> Float[ndarray, "faces 2 2"]:
        """Vectors from the first corner to the others, as columns; meaningless for triangles without an area."""
        inverse = np.where((self.area > 0.0)[:, None, None], self.slopes[:, 1:], np.eye(2))
        return np.asarray(np.linalg.inv(inverse))

    def jacobians(self, uv: Float[ndarray, "faces 3 2"]) -> Float[ndarray, "faces 2 2"]:
        """Jacobians of the linear maps that take these values at the corners."""
        return np.asarray(np.einsum("fkx,fky->fxy", uv, self.slopes))


def relaxed(
    planes: Planes,
    faces: Int[ndarray, "faces 3"],
    uv: Float[ndarray, "vertices 2"],
    wrap: Float[ndarray, "faces 2 2"],
    mirrored: Bool[ndarray, " faces"],
) -> Float[ndarray, "vertices 2"]:
    """UVs moved a little so that fewer triangles are collapsed or wrongly mirrored.

    Local and global steps alternate (as Kovalsky et al. 2015 project on maps of bounded distortion): each triangle
    takes the closest allowed map, and then the vertices take the least-squares fit to these maps, with springs to their
    initial UVs.

    Args:
        planes: of the triangles, in units of the mesh's longest side.
        wrap: Jacobian of the wrap's own map at each triangle, which sets the scale that the triangle should have in UV.
        mirrored: triangles that face away from the wrap and so should be mirrored.
    """
    count = len(uv)
    # A vertex of triangles without an area has a spring too, or the matrix would be singular.
    mass = np.bincount(faces.ravel(), np.repeat(planes.area, 3) / 3, count) / _REACH**2 + _LEAST_AREA
    solve = splu(_stiffness(planes, faces, count) + sparse.diags(mass).tocsc(), permc_spec="MMD_AT_PLUS_A").solve
    gather = sparse.csr_matrix((np.ones(faces.size), (faces.ravel(), np.arange(faces.size))), shape=(count, faces.size))
    weighted = planes.slopes * planes.area[:, None, None]
    # singular values are bounded relative to the wrap's own map
    back, moved = np.linalg.inv(wrap), uv
    for _ in range(_ROUNDS):
        wanted = wrap @ bounded(back @ planes.jacobians(moved[faces]), mirrored, _LEAST)
        pull = np.einsum("fxy,fky->fkx", wanted, weighted).reshape(-1, 2)
        moved = solve(mass[:, None] * uv + gather @ pull)
    return np.asarray(moved)


def misfits(
    planes: Planes,
    uv: Float[ndarray, "faces 3 2"],
    middle: Float[ndarray, "faces 2"],
    wrap: Float[ndarray, "faces 2 2"],
    mirrored: Bool[ndarray, " faces"],
) -> tuple[Int[ndarray, " some"], Float[ndarray, "some 3 2"]]:
    """Triangles that are still collapsed or torn, and for each a well-shaped place of its own around its middle."""
    back = np.linalg.inv(wrap)
    found = back @ planes.jacobians(uv)
    most, least = np.linalg.svd(found, compute_uv=False).T
    least = least * np.where(mirrored, -1.0, 1.0) * np.sign(np.linalg.det(found))
    some = np.flatnonzero(((least < _COLLAPSED) | (most > _TORN)) & (planes.area > 0.0))
    wanted = wrap[some] @ bounded(found[some], mirrored[some], _LEAST, _MOST)
    corners = np.concatenate([np.zeros((len(some), 1, 2)), (wanted @ planes.edges[some]).transpose(0, 2, 1)], axis=1)
    return some, corners - corners.mean(axis=1, keepdims=True) + middle[some, None]


def _stiffness(planes: Planes, faces: Int[ndarray, "faces 3"], count: int) -> sparse.csc_matrix:
    """The cotangent Laplacian of the triangles, positive semidefinite."""
    blocks = np.einsum("fkx,flx,f->fkl", planes.slopes, planes.slopes, planes.area)
    rows, columns = np.repeat(faces, 3, axis=1).ravel(), np.tile(faces, (1, 3)).ravel()
    return sparse.csc_matrix((blocks.ravel(), (rows, columns)), shape=(count, count))


def bounded(
    jacobians: Float[ndarray, "faces 2 2"], mirrored: Bool[ndarray, " faces"], least: float, most: float = np.inf
) -> Float[ndarray, "faces 2 2"]:
    """The closest maps with singular values from `least` to `most`, mirrored exactly where `mirrored` says so.

    A 2 x 2 matrix is the sum of a scaled rotation of size q and a scaled reflection of size r. The signed singular
    values are q + r and q - r; the matrix is mirrored if q - r is negative.
    """
    (a, b), (c, d) = np.moveaxis(jacobians, 0, -1)
    q, turn = _size_and_direction((a + d) / 2, (c - b) / 2)
    r, mirror = _size_and_direction((a - d) / 2, (c + b) / 2)
    first = np.clip(q + r, least, most)
    second = np.where(mirrored, np.clip(q - r, -most, -least), np.clip(q - r, least, most))
    e, h = turn * (first + second) / 2
    f, g = mirror * (first - second) / 2
    return np.asarray(np.moveaxis(np.array([[e + f, g - h], [g + h, e - f]]), -1, 0))


def _size_and_direction(
    x: Float[ndarray, " faces"], y: Float[ndarray, " faces"]
) -> tuple[Float[ndarray, " faces"], Float[ndarray, "2 faces"]]:
    """Lengths and unit directions of vectors; zero vectors get the first axis as direction."""
    size = np.hypot(x, y)
    some = size > 0.0
    return size, np.stack([np.where(some, x, 1.0), np.where(some, y, 0.0)]) / np.where(some, size, 1.0)
