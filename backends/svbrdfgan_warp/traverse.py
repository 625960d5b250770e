"""Warp functions: what a ray meets, and whether it meets anything, in the tree of `tree.py`.

The traversal is that of Ylitie, Karras and Laine, "Efficient Incoherent Ray Traversal on GPUs Through Compressed Wide
BVHs", HPG 2017; triangles are met as in Woop, Benthin and Wald, "Watertight Ray/Triangle Intersection", JCGT 2013.
"""

# mypy: ignore-errors

from importlib import resources

import warp as wp

_WALK = resources.files(__package__).joinpath("native", "traverse.h").read_text(encoding="utf-8")


@wp.func_native(
    _WALK.replace(
        "ON_HIT", "nearest = t; found.f = face; found_u = u / determinant; found_v = v / determinant;"
    ).replace("RESULT", "Word x, y; x.f = found_u; y.f = found_v; return wp::vec3i(found.i, x.i, y.i);")
)
def nearest(
    nodes: wp.array(dtype=wp.uint32), triangles: wp.array2d(dtype=wp.vec4), start: wp.vec3, d: wp.vec3
) -> wp.vec3i:
    """The first face that a ray meets, -1 if none; and the bits of the barycentrics of its first two corners."""


@wp.func_native(_WALK.replace("ON_HIT", "return true;").replace("RESULT", "return false;"))
def blocked(nodes: wp.array(dtype=wp.uint32), triangles: wp.array2d(dtype=wp.vec4), start: wp.vec3, d: wp.vec3) -> bool:
    """Whether a ray meets anything."""
