"""Warp kernels that build the BVH of `bvh.py`, and functions that trace rays through it.

Triangles ordered along a space-filling curve become a binary tree, and that a tree of eight-wide nodes. The nodes of
the binary tree are the `n` triangles, numbered by their faces, and after them the inner nodes.

The traversal follows Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
BVHs", HPG 2017; triangles are intersected as in Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT
2013.
"""

# mypy: ignore-errors

from importlib import resources

import warp as wp

wp.set_module_options({"enable_backward": False})

REACH = wp.constant(8)
"""Clusters before and after it on the curve among which a cluster looks for its partner."""

_NATIVE = resources.files(__package__).joinpath("native")
_WIDEN, TRAVERSE = (_NATIVE.joinpath(name).read_text(encoding="utf-8") for name in ("widen.h", "traverse.h"))


@wp.struct
class BinaryTree:
    children: wp.array(dtype=wp.vec2i)  # of the inner nodes
    counts: wp.array(dtype=wp.int32)  # triangles under each node
    lower: wp.array(dtype=wp.vec3)
    upper: wp.array(dtype=wp.vec3)


@wp.struct
class WideTree:
    nodes: wp.array(dtype=wp.uint32)  # 20 words each
    sources: wp.array(dtype=wp.int32)  # the binary node that each is made from
    order: wp.array(dtype=wp.int32)  # faces, in the order of the nodes' references
    counters: wp.array(dtype=wp.int32)  # nodes, and triangles, so far


@wp.kernel
def bound_triangles(
    points: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=wp.int32),
    slack: float,
    binary: BinaryTree,
):
    """The bounds of the triangles, widened by `slack`."""
    i = wp.tid()
    a = points[corners[i * 3]]
    b = points[corners[i * 3 + 1]]
    c = points[corners[i * 3 + 2]]
    binary.lower[i] = wp.min(wp.min(a, b), c) - wp.vec3(slack)
    binary.upper[i] = wp.max(wp.max(a, b), c) + wp.vec3(slack)


@wp.kernel
def find_partners(
    clusters: wp.array(dtype=wp.int32),
    binary: BinaryTree,
    partner: wp.array(dtype=wp.int64),
):
    """Finds for each cluster on the curve the nearby cluster with which it has the smallest joint surface.

    Ties go to the cluster whose index differs in the lowest bits, so that a row of coincident boxes pairs off in one
    round. Both criteria are symmetric and no two neighbours tie in both, so at least one pair chooses each other.
    """
    i = wp.tid()
    low = binary.lower[clusters[i]]
    high = binary.upper[clusters[i]]
    least = float(3.4e38)  # noqa: UP018 - Warp's way to declare a variable
    best = int(-1)  # noqa: UP018, RUF046
    for j in range(wp.max(0, i - REACH), wp.min(clusters.shape[0], i + REACH + 1)):
        if j != i:
            d = wp.max(high, binary.upper[clusters[j]]) - wp.min(low, binary.lower[clusters[j]])
            area = d[0] * d[1] + d[1] * d[2] + d[2] * d[0]
            if best < 0 or area < least or (area == least and (i ^ j) < (i ^ best)):
                least = area
                best = j
    partner[i] = wp.int64(best)


@wp.func_native(_WIDEN)
def widened(wide: int, n: int, binary: BinaryTree, grown: WideTree): ...


@wp.kernel
def widen(begin: int, n: int, binary: BinaryTree, grown: WideTree):
    """Fills the wide nodes from `begin` on, whose binary nodes are known, and appends their children."""
    widened(begin + wp.tid(), n, binary, grown)


@wp.kernel
def copy_triangles(
    points: wp.array(dtype=wp.vec3),
    corners: wp.array(dtype=wp.int32),
    order: wp.array(dtype=wp.int32),
    triangles: wp.array2d(dtype=wp.vec4),
):
    """Copies the triangles' corners in the tree's order, with the face's number in the first one's fourth component."""
    i = wp.tid()
    face = order[i]
    a = points[corners[face * 3]]
    b = points[corners[face * 3 + 1]]
    c = points[corners[face * 3 + 2]]
    triangles[i, 0] = wp.vec4(a[0], a[1], a[2], wp.cast(face, wp.float32))
    triangles[i, 1] = wp.vec4(b[0], b[1], b[2], 0.0)
    triangles[i, 2] = wp.vec4(c[0], c[1], c[2], 0.0)


@wp.func_native(
    TRAVERSE.replace(
        "ON_HIT", "nearest = t; found.f = face; found_u = u / determinant; found_v = v / determinant;"
    ).replace("RESULT", "Word x, y; x.f = found_u; y.f = found_v; return wp::vec3i(found.i, x.i, y.i);")
)
def nearest(
    nodes: wp.array(dtype=wp.uint32), triangles: wp.array2d(dtype=wp.vec4), start: wp.vec3, d: wp.vec3
) -> wp.vec3i:
    """The first face that a ray hits, -1 for none; and the bits of the barycentrics of its first two corners."""


@wp.func_native(TRAVERSE.replace("ON_HIT", "return true;").replace("RESULT", "return false;"))
def blocked(nodes: wp.array(dtype=wp.uint32), triangles: wp.array2d(dtype=wp.vec4), start: wp.vec3, d: wp.vec3) -> bool:
    """Whether a ray hits anything."""
