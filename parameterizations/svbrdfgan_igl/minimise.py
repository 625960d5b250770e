"""Projected Newton descent over maps without flips: a map that starts one-to-one stays so at every step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse
from scipy.sparse.linalg import splu

from svbrdfgan_igl.boundary_barrier import BoundaryBarrier
from svbrdfgan_igl.collision_barrier import SelfCollisionBarrier
from svbrdfgan_igl.crossing import loop_crosses_itself
from svbrdfgan_igl.energy import DistortionEnergy, RestTriangles

_ENOUGH_DECREASE = 1e-4  # Armijo's constant: least share of the predicted decrease (Nocedal and Wright 2006, 3.1)
_SHORTEST_STEP = 1e-7  # of Newton's: with shorter ones, rounding decides whether the value falls
_BEFORE_FLIP = 0.95  # share of the way to the first degenerate triangle, at which the energy is infinite


@dataclass(frozen=True, eq=False)
class Objective:
    """The distortion of a chart, with the barriers that keep its border inside a container and off itself."""

    triangles: RestTriangles
    distortion: DistortionEnergy
    boundary: BoundaryBarrier
    collision: SelfCollisionBarrier

    def value(self, uv: Float[ndarray, "vertices 2"]) -> float:
        """The sum of distortion and barriers; infinite for maps with flips or vertices outside the container."""
        boundary = self.boundary.value(uv)
        distortion = self.distortion.value(self.triangles, uv) if np.isfinite(boundary) else boundary
        return boundary + distortion + self.collision.value(uv) if np.isfinite(distortion) else distortion

    def newton(self, uv: Float[ndarray, "vertices 2"]) -> tuple[Float[ndarray, "vertices 2"], float]:
        """Newton's step among those that do not rotate the border as a whole, and the slope along it (negative)."""
        parts = [
            (self.triangles.faces, *self.distortion.derivatives(self.triangles, uv)),
            (self.boundary.border[:, None], *self.boundary.derivatives(uv)),
            self.collision.derivatives(uv),
        ]
        size = uv.size
        total = np.zeros(size)
        matrix = sparse.csr_matrix((size, size))
        for vertices, gradient, hessian in parts:
            unknowns = _unknowns(vertices)
            total += np.bincount(unknowns.ravel(), gradient.ravel(), size)
            matrix = matrix + _assemble(unknowns, hessian, size)
        # rounding may leave the sum of semidefinite blocks singular; a small diagonal term keeps it definite
        matrix += sparse.diags(1e-10 * matrix.diagonal().mean() * np.ones(size))
        solver = splu(
            matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
        )
        step = solver.solve(-total)
        # the step under the linear constraint turn @ step = 0: it keeps the vehicle's orientation in the chart
        turn = self._turn(uv)
        answer = solver.solve(turn)
        step -= answer * (turn @ step) / max(turn @ answer, 1e-300)
        return step.reshape(-1, 2), float(step @ total)

    def _turn(self, uv: Float[ndarray, "vertices 2"]) -> Float[ndarray, " unknowns"]:
        """The weighted motion of the border when all of it rotates about the origin."""
        turn = np.zeros_like(uv)
        turn[self.boundary.border] = uv[self.boundary.border][:, ::-1] * (-1.0, 1.0) * self.boundary.weight[:, None]
        return turn.ravel()


def minimise(
    objective: Objective, uv: Float[ndarray, "vertices 2"], rounds: int, tolerance: float
) -> Float[ndarray, "vertices 2"]:
    """The map after at most `rounds` Newton steps.

    The descent stops earlier if the slope along a step is less than `tolerance` of the value, or no step lowers the
    value.
    `uv` must be a map with a finite value. No step flips a triangle, leaves the container, or makes the border cross
    itself.
    """
    value = objective.value(uv)
    for _ in range(rounds):
        step, slope = objective.newton(uv)
        if -slope < tolerance * abs(value):
            break
        found = _search(objective, uv, step, slope, value)
        if found is None:
            break
        uv, value = found
    return uv


def _search(
    objective: Objective,
    uv: Float[ndarray, "vertices 2"],
    step: Float[ndarray, "vertices 2"],
    slope: float,
    value: float,
) -> tuple[Float[ndarray, "vertices 2"], float] | None:
    """Backtracking line search: halves the step until the map is allowed and lowers the value enough."""
    length = min(1.0, _BEFORE_FLIP * _until_flip(objective.triangles.faces, uv, step))
    while length > _SHORTEST_STEP:
        trial = uv + length * step
        reached = objective.value(trial)
        lower = reached <= value + _ENOUGH_DECREASE * length * slope
        if lower and not loop_crosses_itself(trial[objective.boundary.border]):
            return trial, reached
        length /= 2
    return None


def _until_flip(
    faces: Int[ndarray, "faces 3"], uv: Float[ndarray, "vertices 2"], step: Float[ndarray, "vertices 2"]
) -> float:
    """The greatest multiple of the step before a triangle degenerates (Smith and Schaefer 2015)."""
    (p, q), (dp, dq) = ([x[faces[:, k]] - x[faces[:, 0]] for k in (1, 2)] for x in (uv, step))
    a, c = _cross(dp, dq), _cross(p, q)
    b = _cross(p, dq) + _cross(dp, q)
    root = np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))
    real = b * b >= 4 * a * c
    with np.errstate(divide="ignore", invalid="ignore"):  # divisions by 0 are missing roots, left out below
        half = -0.5 * (b + np.where(b >= 0, root, -root))  # both terms have the same sign, so that no digits cancel
        roots = np.stack([half / a, c / half])
    roots = roots[:, real]
    positive = roots[np.isfinite(roots) & (roots > 0.0)]
    return float(positive.min(initial=np.inf))


def _cross(a: Float[ndarray, "n 2"], b: Float[ndarray, "n 2"]) -> Float[ndarray, " n"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _unknowns(vertices: Int[ndarray, "n corners"]) -> Int[ndarray, "n unknowns"]:
    return (2 * vertices[:, :, None] + np.arange(2)).reshape(len(vertices), 2 * vertices.shape[1])


def _assemble(unknowns: Int[ndarray, "n k"], blocks: Float[ndarray, "n k k"], size: int) -> sparse.csr_matrix:
    width = unknowns.shape[1]
    row, col = np.repeat(unknowns, width, axis=1).ravel(), np.tile(unknowns, (1, width)).ravel()
    return sparse.coo_matrix((blocks.ravel(), (row, col)), shape=(size, size)).tocsr()
