"""A bounding volume hierarchy over triangles, searched by many rays at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan_numpy.vectors import cross, dot

LEAF_FACES = 2
"""A leaf holds from this many faces to twice as many."""

Stops = Callable[[Int[ndarray, " hits"], Int[ndarray, " hits"], Float[ndarray, "hits 2"]], Bool[ndarray, " hits"]]
"""Whether rays end where they meet faces: takes indices of rays and faces, and barycentrics as `Hits` has them.

A ray and a face always give the same answer, as a search may meet them again.
"""


@dataclass(frozen=True, eq=False)
class Hits:
    """The nearest hit of each ray so far; a search fills the arrays in place.

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
        """No hits yet."""
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
        """Stores those tries that are nearer than their ray's hit. No ray may occur twice.

        Of equally near faces the one with the lowest index wins, so that the tree's shape does not show.
        """
        tie = (distance == self.distance[ray]) & (face < self.face[ray])
        nearer = (distance < self.distance[ray]) | tie
        self.face[ray[nearer]] = face[nearer]
        self.distance[ray[nearer]] = distance[nearer]
        self.barycentric[ray[nearer]] = barycentric[nearer]


@dataclass(frozen=True, eq=False)
class Bvh:
    """A complete binary tree: node 1 is the root, the children of node k are 2k and 2k + 1, all leaves equally deep.

    Attributes:
        corners: of each triangle, in the order of the surface's faces.
        order: faces in the order of the leaves; leaf k of n holds `order[k * faces // n : (k + 1) * faces // n]`.
        bounds: lower and upper corner of each node's box. Node 0 is unused.
        axis: along which each inner node was split; its first child is the one with the lower coordinates.
    """

    corners: Float[ndarray, "faces 3 3"]
    order: Int[ndarray, " faces"]
    bounds: Float[ndarray, "nodes 2 3"]
    axis: Int[ndarray, " inner"]

    @property
    def leaves(self) -> int:
        return len(self.axis)


def build(corners: Float[ndarray, "faces 3 3"]) -> Bvh:
    """The tree that splits each node's faces into equal halves along the longest axis of their centres."""
    depth = int(np.log2(max(1, len(corners) // LEAF_FACES)))
    centres = corners.mean(axis=1)
    order = np.arange(len(corners))
    bounds, axes = [np.zeros((1, 2, 3))], [np.zeros(1, dtype=np.int64)]
    for level in range(depth + 1):
        starts = np.arange(2**level) * len(corners) // 2**level
        bounds.append(_boxes(corners[order].min(axis=1), corners[order].max(axis=1), starts))
        if level < depth:
            spread = _boxes(centres[order], centres[order], starts)
            axes.append((spread[:, 1] - spread[:, 0]).argmax(axis=1))
            node = np.repeat(np.arange(2**level), np.diff(starts, append=len(corners)))
            order = order[np.lexsort((centres[order, axes[-1][node]], node))]
    return Bvh(corners, order, np.concatenate(bounds), np.concatenate(axes))


def search(
    bvh: Bvh,
    origin: Float[ndarray, "rays 3"],
    direction: Float[ndarray, "rays 3"],
    *,
    any_hit: bool = False,
    stops: Stops | None = None,
) -> Hits:
    """The first triangle that each ray meets; with `any_hit`, any triangle, which is faster.

    Depth first, near child first: in each step every unfinished ray pops one node from its own stack.

    Args:
        stops: decides which triangles count; without it all do.
    """
    hits = Hits.none(len(origin))
    inverse = 1.0 / np.where(direction == 0.0, 1e-300, direction)  # finite, so that 0 * inverse is not NaN
    stack = np.ones((len(origin), bvh.leaves.bit_length() + 1), dtype=np.int64)
    height = np.ones(len(origin), dtype=np.int64)
    active = np.arange(len(origin))
    while len(active):
        height[active] -= 1
        node = stack[active, height[active]]
        enters = _enters(bvh.bounds[node], origin[active], inverse[active], hits.distance[active])
        ray, node = active[enters], node[enters]
        leaf = node >= bvh.leaves
        _visit_leaves(bvh, hits, ray[leaf], node[leaf], origin, direction, stops)
        _push_children(bvh, stack, height, ray[~leaf], node[~leaf], direction)
        done = (height[active] == 0) | (any_hit & (hits.face[active] >= 0))
        active = active[~done]
    return hits


def intersect(
    corners: Float[ndarray, "pairs 3 3"], origin: Float[ndarray, "pairs 3"], direction: Float[ndarray, "pairs 3"]
) -> tuple[Float[ndarray, " pairs"], Float[ndarray, "pairs 2"]]:
    """Distance and barycentrics where each ray meets its triangle, infinite where it does not.

    Both sides and the edges count (Möller and Trumbore 1997).
    """
    edge1, edge2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p = cross(direction, edge2)
    determinant = dot(edge1, p)
    inverse = 1.0 / np.where(determinant == 0.0, np.inf, determinant)  # parallel rays get distance 0: no hit
    s = origin - corners[:, 0]
    q = cross(s, edge1)
    u, v, distance = dot(s, p) * inverse, dot(direction, q) * inverse, dot(edge2, q) * inverse
    meets = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
    return np.where(meets, distance, np.inf), np.stack([u, v], axis=-1)


def _boxes(
    lower: Float[ndarray, "faces 3"], upper: Float[ndarray, "faces 3"], starts: Int[ndarray, " nodes"]
) -> Float[ndarray, "nodes 2 3"]:
    return np.stack([np.minimum.reduceat(lower, starts), np.maximum.reduceat(upper, starts)], axis=1)


def _enters(
    bounds: Float[ndarray, "rays 2 3"],
    origin: Float[ndarray, "rays 3"],
    inverse: Float[ndarray, "rays 3"],
    limit: Float[ndarray, " rays"],
) -> Bool[ndarray, " rays"]:
    """Whether each ray meets its box before `limit`."""
    slabs = (bounds - origin[:, None]) * inverse[:, None]
    near, far = np.minimum(slabs[:, 0], slabs[:, 1]), np.maximum(slabs[:, 0], slabs[:, 1])
    enter = np.maximum(np.maximum(near[:, 0], near[:, 1]), near[:, 2])
    # Slightly too far: rounding must not make a ray miss the box of a flat or grazed triangle.
    leave = np.minimum(np.minimum(far[:, 0], far[:, 1]), far[:, 2]) * (1.0 + 1e-12)
    return (enter <= leave) & (leave >= 0.0) & (enter <= limit)


def _visit_leaves(
    bvh: Bvh,
    hits: Hits,
    ray: Int[ndarray, " visits"],
    node: Int[ndarray, " visits"],
    origin: Float[ndarray, "rays 3"],
    direction: Float[ndarray, "rays 3"],
    stops: Stops | None,
) -> None:
    """Intersects each ray with every face of its leaf."""
    faces = len(bvh.order)
    start, stop = ((node - bvh.leaves + k) * faces // bvh.leaves for k in (0, 1))
    for step in range(-(-faces // bvh.leaves)):
        face = bvh.order[np.minimum(start + step, stop - 1)]
        distance, barycentric = intersect(bvh.corners[face], origin[ray], direction[ray])
        if stops is not None:
            met = np.flatnonzero(distance < np.inf)
            distance[met[~stops(ray[met], face[met], barycentric[met])]] = np.inf
        hits.keep_nearer(ray, face, distance, barycentric)


def _push_children(
    bvh: Bvh,
    stack: Int[ndarray, "rays depth"],
    height: Int[ndarray, " rays"],
    ray: Int[ndarray, " visits"],
    node: Int[ndarray, " visits"],
    direction: Float[ndarray, "rays 3"],
) -> None:
    """Pushes both children on each ray's stack, the one that it probably meets first on top."""
    backward = direction[ray, bvh.axis[node]] < 0.0
    stack[ray, height[ray]] = 2 * node + ~backward
    stack[ray, height[ray] + 1] = 2 * node + backward
    height[ray] += 2
