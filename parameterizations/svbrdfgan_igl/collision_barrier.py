"""The self-collision barrier: it keeps distant stretches of a chart's border apart (after Li et al. 2020)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan_igl.crossing import close_pairs

_OF_INITIAL = 0.5  # of a pair's initial distance: its gap is at most this, so that no pair repels at first


@dataclass(frozen=True, eq=False)
class SelfCollisionBarrier:
    """-stiffness * sum of weight * (s - 1)^2 log(s), s = distance / gap, over vertices and edges within a gap.

    Attributes:
        border: the vertices around the chart.
        weight: share of the border's length that each vertex represents.
        initial: the border at the start of the descent, where close vertices along it may be nearer than the gap.
        gap: greatest distance at which pairs repel, in units of the plane.
    """

    border: Int[ndarray, " loop"]
    weight: Float[ndarray, " loop"]
    initial: Float[ndarray, "loop 2"]
    gap: float
    stiffness: float

    def value(self, uv: Float[ndarray, "vertices 2"]) -> float:
        """The cost; zero if no pair is closer than its gap."""
        pairs, distance, gap, _ = self._near(uv[self.border])
        s = np.maximum(distance, 1e-300) / gap  # the logarithm stays finite where a vertex lies on an edge
        return float(-self.stiffness * (self.weight[pairs[:, 0]] * (s - 1) ** 2 * np.log(s)).sum())

    def derivatives(
        self, uv: Float[ndarray, "vertices 2"]
    ) -> tuple[Int[ndarray, "pairs 3"], Float[ndarray, "pairs 6"], Float[ndarray, "pairs 6 6"]]:
        """The vertices of each close pair, with gradient and positive semidefinite Hessian of its cost."""
        pairs, distance, gap, slope = self._near(uv[self.border])
        s = np.maximum(distance, 1e-300) / gap
        scale = self.stiffness * self.weight[pairs[:, 0]]
        first = scale * (-2 * (s - 1) * np.log(s) - (s - 1) ** 2 / s) / gap
        second = scale * (-2 * np.log(s) - 4 * (s - 1) / s + (s - 1) ** 2 / s**2) / gap**2
        outer = slope[:, :, None] * slope[:, None, :]
        return self.border[pairs], first[:, None] * slope, second[:, None, None] * outer

    def _near(
        self, points: Float[ndarray, "loop 2"]
    ) -> tuple[Int[ndarray, "pairs 3"], ndarray, ndarray, Float[ndarray, "pairs 6"]]:
        """Close pairs of a vertex and an edge (by place along the border), distance, gap, gradient of the distance."""
        pairs = _vertices_and_edges(points, self.gap)
        before, _, _ = _distances(self.initial, pairs)
        distance, normal, along = _distances(points, pairs)
        gap = np.minimum(self.gap, _OF_INITIAL * before)
        near = distance < gap
        share = np.stack([np.ones_like(along), along - 1.0, -along], axis=1)[near]
        slope = (share[:, :, None] * normal[near][:, None, :]).reshape(-1, 6)
        return pairs[near], distance[near], gap[near], slope


def _vertices_and_edges(points: Float[ndarray, "loop 2"], gap: float) -> Int[ndarray, "pairs 3"]:
    """Pairs of a vertex and an edge (its two ends) that are not incident and may be less than a gap apart."""
    count = len(points)
    one, other = close_pairs(points, gap)
    vertex = np.concatenate([one, one + 1, other, other + 1]) % count
    edge = np.concatenate([other, other, one, one])
    keys = np.unique(vertex * count + edge)
    vertex, edge = np.divmod(keys, count)
    after = (edge + 1) % count
    apart = (vertex != edge) & (vertex != after)
    return np.stack([vertex, edge, after], axis=1)[apart]


def _distances(
    points: Float[ndarray, "loop 2"], pairs: Int[ndarray, "pairs 3"]
) -> tuple[Float[ndarray, " pairs"], Float[ndarray, "pairs 2"], Float[ndarray, " pairs"]]:
    """Distance from vertex to edge, its unit direction, and the closest point's parameter on the edge in [0, 1]."""
    p, a, b = (points[pairs[:, k]] for k in range(3))
    edge = b - a
    along = np.einsum("nx,nx->n", p - a, edge) / np.maximum(np.einsum("nx,nx->n", edge, edge), 1e-300)
    along = np.clip(along, 0.0, 1.0)
    away = p - a - along[:, None] * edge
    distance = np.linalg.norm(away, axis=1)
    return distance, away / np.maximum(distance, 1e-300)[:, None], along  # a vertex may lie on an edge
