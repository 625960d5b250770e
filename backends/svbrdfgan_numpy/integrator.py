"""Paths: from the camera over the surface to the light. They depend on geometry and light, never on materials.

At each of its vertices a path gathers light from two directions, one drawn where the light is bright and one as the
BSDF reflects; along the second it goes on, if something is there. With x_0 the vertex the camera sees, a_k the base
colour at x_k and e_k the light gathered there per unit of base colour, a path carries a_0 (e_0 + a_1 (e_1 + ...)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import View
from svbrdfgan_numpy import diffuse
from svbrdfgan_numpy.bvh import search
from svbrdfgan_numpy.camera import camera_rays
from svbrdfgan_numpy.environment import Light
from svbrdfgan_numpy.surface import Points, PreparedSurface, points_at
from svbrdfgan_numpy.taps import Taps


@dataclass(frozen=True, eq=False)
class Bounce:
    """The vertices of many paths at one depth; a path that has left the scene has none.

    Attributes:
        path: which of the paths each vertex belongs to, no path twice.
        part: index into the surface's parts.
        uv: texture coordinates.
        light: the light gathered there, per unit of base colour, as a sum over the environment's pixels.
    """

    path: Int[ndarray, " vertices"]
    part: Int[ndarray, " vertices"]
    uv: Float[ndarray, "vertices 2"]
    light: Taps


def trace_paths(
    prepared: PreparedSurface, light: Light, view: View, paths: range, *, spp: int, seed: int, max_bounces: int
) -> Iterator[Bounce]:
    """The bounces of some paths, first to last. Path i belongs to pixel i // spp; bounces number them from 0."""
    bvh, offset, path = prepared.bvh, prepared.offset, np.arange(len(paths))
    origin, direction = camera_rays(view, (paths.start + path) // spp, uniforms(seed, 0, paths)[:, :2])
    hits = search(bvh, origin, direction)
    for depth in range(1, max_bounces + 1):
        path, points = path[hits.found], points_at(prepared, hits, direction)
        random = uniforms(seed, depth, paths)[path]
        to_light, direction = light.sample(random[:, :2]), diffuse.sample(points.normal, random[:, 2:])
        shadow = search(bvh, points.leave(to_light, offset), to_light, any_hit=True)
        hits = search(bvh, points.leave(direction, offset), direction, any_hit=depth == max_bounces)
        gathered = _gather(light, points, to_light, ~shadow.found), _gather(light, points, direction, ~hits.found)
        yield Bounce(path, points.part, points.uv, Taps.summed(gathered))


def uniforms(seed: int, depth: int, paths: range) -> Float[ndarray, "paths 4"]:
    """Four numbers in [0, 1) for each path at each depth, the same whichever paths are asked for together.

    Philox is a function of a key and a counter (Salmon et al. 2011): seed and depth are the key, the path the counter.
    """
    key = np.array([seed % 2**64, depth], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=paths.start)).random((len(paths), 4))


def _gather(
    light: Light, points: Points, direction: Float[ndarray, "points 3"], visible: Bool[ndarray, " points"]
) -> Taps:
    """The light reflected from directions that were drawn by either strategy, combined by the balance heuristic.

    It weighs a sample of density p_i by p_i / (p_1 + p_2), so f / p_i becomes f / (p_1 + p_2) for both (Veach 1995).
    """
    reflected = diffuse.evaluate(points.normal, direction)
    density = light.pdf(direction) + diffuse.pdf(points.normal, direction)
    weight = np.divide(reflected, density, out=np.zeros_like(reflected), where=visible & (reflected > 0.0))
    return light.taps(direction).scaled(weight)
