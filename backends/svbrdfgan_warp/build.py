"""Warp kernels: from triangles along a space-filling curve to a binary tree, and from that to the tree of `tree.py`.

Nodes of the binary tree are numbered: `n` triangles, by their faces, and after them what was merged of two.
"""

# mypy: ignore-errors

from importlib import resources

import warp as wp

wp.set_module_options({"enable_backward": False})

REACH = wp.constant(8)
"""How far along the curve a cluster looks for its partner."""
_WIDEN = resources.files(__package__).joinpath("native", "widen.h").read_text(encoding="utf-8")


@wp.struct
class Binary:
    children: wp.array(dtype=wp.vec2i)  # of the inner nodes
    counts: wp.array(dtype=wp.int32)  # triangles under each node
    lower: wp.array(dtype=wp.vec3)
    upper: wp.array(dtype=wp.vec3)


@wp.struct
class Wide:
    nodes: wp.array(dtype=wp.uint32)  # 20 words each
    sources: wp.array(dtype=wp.int32)  # for each, the binary node that it is made of
    order: wp.array(dtype=wp.int32)  # faces, as the nodes name them
    counters: wp.array(dtype=wp.int32)  # nodes, and triangles, so far


@wp.kernel
def bound(
    points: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=wp.int32),
    slack: float,
    binary: Binary,
):
    """The bounds of the triangles, widened by `slack`."""
    i = wp.tid()
    a = points[corners[i * 3]]
    b = points[corners[i * 3 + 1]]
    c = points[corners[i * 3 + 2]]
    binary.lower[i] = wp.min(wp.min(a, b), c) - wp.vec3(slack)
    binary.upper[i] = wp.max(wp.max(a, b), c) + wp.vec3(slack)


@wp.kernel
def choose(
    clusters: wp.array(dtype=wp.int32),
    binary: Binary,
    partner: wp.array(dtype=wp.int64),
):
    """For each cluster on the curve, the near one that together with it has the least surface.

    Of equals the one whose index differs in the lowest bits, so that a row of coincident boxes pairs off at once. Both
    keys are the same from either side, and no two neighbours share an index: some two always choose each other.
    """
    i = wp.tid()
    low = binary.lower[clusters[i]]
    high = binary.upper[clusters[i]]
    least = float(3.4e38)  # noqa: UP018 - Warp's way to declare a variable
    best = int(-1)  # noqa: UP018, RUF046
    for j in range(wp.max(0, i - REACH), wp.min(clusters.shape[0], i + REACH + 1)):
        if j != i:
            d = wp.max(high, binary.upper[clusters[j]]) - wp.min(low, binary.lower[clusters[j]])
            surface = d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
            if best < 0 or surface < least or (surface == least and (i ^ j) < (i ^ best)):
                least = surface
                best = j
    partner[i] = wp.int64(best)


@wp.func_native(_WIDEN)
def widened(wide: int, n: int, binary: Binary, grown: Wide): ...


@wp.kernel
def widen(begin: int, n: int, binary: Binary, grown: Wide):
    """The wide nodes from `begin` on, whose binary ones are known; adds their children at the end."""
    widened(begin + wp.tid(), n, binary, grown)


@wp.kernel
def place(
    points: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=wp.int32),
    placed_order: wp.array(dtype=wp.int32),
    triangles: wp.array2d(dtype=wp.vec4),
):
    """Each triangle's corners where the tree names it; the face's number rides along."""
    i = wp.tid()
    face = placed_order[i]
    a = points[corners[face * 3]]
    b = points[corners[face * 3 + 1]]
    c = points[corners[face * 3 + 2]]
    triangles[i, 0] = wp.vec4(a[0], a[1], a[2], wp.cast(face, wp.float32))
    triangles[i, 1] = wp.vec4(b[0], b[1], b[2], 0.0)
    triangles[i, 2] = wp.vec4(c[0], c[1], c[2], 0.0)
