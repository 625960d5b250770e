"""A bounding volume hierarchy of eight-wide nodes over a surface's triangles, built on the device.

A node takes 80 bytes: its lower corner; the exponents of a grid of 255 steps per axis, and a mask of the slots with
inner children; the indices of its first inner child and first triangle; and for each of eight slots a byte that says
what it holds, and its bounds on the grid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan_warp import bvh_kernels
from svbrdfgan_warp.device import launch

_SLACK = 2e-6
"""Share of the largest coordinate by which bounds are widened; the traversal rounds by less than a quarter of it."""
_BITS = 21
"""Bits of each coordinate in a Morton code; three times 21 fit into a signed 64-bit integer."""


def build_bvh(points: Float[Tensor, "vertices 3"], corners: Int[Tensor, " 3_faces"]) -> tuple[Any, Any]:
    """The nodes, and the triangles in the order of the nodes' references, as the traversal takes them.

    A triangle is its three corners; the fourth component of the first holds the bits of its face's number. The points
    should be centred at the origin: bounds are widened in proportion to the largest coordinate, as float32 rounds.
    """
    faces = len(corners) // 3
    twice = corners.repeat(2) if faces == 1 else corners  # a binary tree has at least two leaves
    mesh = (wp.from_torch(points, wp.vec3), wp.from_torch(twice))
    corner = points[twice.long()].view(-1, 3, 3)  # of faces only: unused points may lie anywhere
    tree = _clustered(mesh, _morton_codes(corner).argsort(), _SLACK * float(corner.abs().max()))
    nodes, order = _widened(tree)
    triangles = torch.empty(len(order), 3, 4, dtype=torch.float32, device=points.device)
    copies = wp.from_torch(triangles, wp.vec4)
    launch(bvh_kernels.copy_triangles, len(order), (*mesh, wp.from_torch(order % faces), copies), points.device)
    return wp.from_torch(nodes.view(-1), wp.uint32), copies


@dataclass(frozen=True, eq=False)
class _BinaryTree:
    """A binary tree, whose nodes are the triangles, numbered by their faces, then the inner ones; the last is the root.

    Attributes:
        children: of the inner nodes.
        counts: triangles under each node.
        lower, upper: bounds of each node.
    """

    children: Int[Tensor, "inner 2"]
    counts: Int[Tensor, " nodes"]
    lower: Float[Tensor, "nodes 3"]
    upper: Float[Tensor, "nodes 3"]

    @classmethod
    def empty(cls, n: int, device: torch.device) -> _BinaryTree:
        nodes = 2 * n - 1
        children = torch.empty(n - 1, 2, dtype=torch.int32, device=device)
        counts = torch.ones(nodes, dtype=torch.int32, device=device)
        lower, upper = (torch.empty(nodes, 3, dtype=torch.float32, device=device) for _ in range(2))
        return cls(children, counts, lower, upper)

    def argument(self) -> bvh_kernels.BinaryTree:
        """The tree as kernels take it."""
        result: Any = bvh_kernels.BinaryTree()
        result.children, result.counts = wp.from_torch(self.children, wp.vec2i), wp.from_torch(self.counts)
        result.lower, result.upper = wp.from_torch(self.lower, wp.vec3), wp.from_torch(self.upper, wp.vec3)
        return result

    def merge(self, node: int, first: Int[Tensor, " pairs"], second: Int[Tensor, " pairs"]) -> Int[Tensor, " pairs"]:
        """The numbers of new nodes, from `node` on, each the parent of a first and a second child."""
        new = torch.arange(node, node + len(first), device=first.device)
        self.children[new - (len(self.children) + 1)] = torch.stack([first, second], dim=1)
        self.counts[new] = self.counts[first] + self.counts[second]
        self.lower[new] = torch.minimum(self.lower[first], self.lower[second])
        self.upper[new] = torch.maximum(self.upper[first], self.upper[second])
        return new.int()


def _clustered(mesh: tuple[Any, Any], order: Int[Tensor, " triangles"], slack: float) -> _BinaryTree:
    """The tree that comes from merging, round by round, those neighbours on the curve that choose each other.

    Meister and Bittner, "Parallel Locally-Ordered Clustering for Bounding Volume Hierarchy Construction", TVCG 2018.
    """
    device, node = order.device, len(order)
    tree, clusters = _BinaryTree.empty(node, device), order.int()
    argument = tree.argument()
    launch(bvh_kernels.bound_triangles, node, (*mesh, slack, argument), device)
    while len(clusters) > 1:
        partner = torch.empty(len(clusters), dtype=torch.int64, device=device)
        given = (wp.from_torch(clusters), argument, wp.from_torch(partner))
        launch(bvh_kernels.find_partners, len(clusters), given, device)
        index = torch.arange(len(clusters), device=device)
        mutual = partner[partner] == index
        first = (mutual & (index < partner)).nonzero().squeeze(1)
        clusters[first] = tree.merge(node, clusters[first], clusters[partner[first]])
        clusters = clusters[~(mutual & (index > partner))]
        node += len(first)
    return tree


def _widened(tree: _BinaryTree) -> tuple[Int[Tensor, "nodes 20"], Int[Tensor, " triangles"]]:
    """The wide nodes, made level by level, and the faces in the order of the nodes' references."""
    device, n = tree.counts.device, len(tree.children) + 1
    integers: dict[str, Any] = {"dtype": torch.int32, "device": device}
    nodes, order = torch.empty(n, 20, **integers), torch.empty(n, **integers)
    sources = torch.full((n,), 2 * n - 2, **integers)  # the binary node that each wide node is made from
    counters = torch.tensor([1, 0], **integers)  # nodes and triangles so far
    wide: Any = bvh_kernels.WideTree()
    wide.nodes, wide.sources = wp.from_torch(nodes.view(-1), wp.uint32), wp.from_torch(sources)
    wide.order, wide.counters = wp.from_torch(order), wp.from_torch(counters)
    argument, begin, end = tree.argument(), 0, 1
    while begin < end:
        launch(bvh_kernels.widen, end - begin, (begin, n, argument, wide), device)
        begin, end = end, int(counters[0])
    return nodes[:end].clone(), order


def _morton_codes(corner: Float[Tensor, "triangles 3 3"]) -> Int[Tensor, " triangles"]:
    """The position of each triangle's middle along a Morton curve of 2^63 cells."""
    middle = (corner.amin(dim=1) + corner.amax(dim=1)) / 2
    # One triangle alone has no size to divide by.
    low, size = middle.amin(dim=0), (middle.amax(dim=0) - middle.amin(dim=0)).amax().clamp_min(1e-30)
    cell = ((middle - low) / size * (2**_BITS - 1)).long().clamp(0, 2**_BITS - 1)
    return _spread(cell[:, 0]) << 2 | _spread(cell[:, 1]) << 1 | _spread(cell[:, 2])


def _spread(x: Int[Tensor, " triangles"]) -> Int[Tensor, " triangles"]:
    """The 21 lowest bits, with two zero bits between neighbours."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | x << shift) & mask
    return x
