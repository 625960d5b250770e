"""Paths from the camera over the surface to the light.

They depend on geometry, light and which parts are glossy, never on the values of maps. So with a fixed seed a picture
is a smooth function of those values, and its derivative is exactly that of the estimator.

At each vertex a path gathers light from two directions, one drawn where the light is bright and one as the surface
scatters. Along the second it goes on, if it meets something there. `shading.Reflection` holds what it carries.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import View
from svbrdfgan_numpy import scattering
from svbrdfgan_numpy.bvh import search
from svbrdfgan_numpy.environment import EnvironmentEmitter
from svbrdfgan_numpy.scattering import Scattering
from svbrdfgan_numpy.shading import Bounce, Gloss, Reflection
from svbrdfgan_numpy.surface import Points, PreparedSurface, points_at
from svbrdfgan_numpy.textures import Taps


@dataclass(frozen=True, eq=False)
class PathTracer:
    """Everything that paths depend on.

    Attributes:
        glossy: whether the material of each part has `roughness`.
    """

    prepared: PreparedSurface
    emitter: EnvironmentEmitter
    view: View
    glossy: Bool[ndarray, " parts"]

    def trace(self, paths: range, *, spp: int, seed: int, max_bounces: int) -> Iterator[Bounce]:
        """The bounces of some paths, first to last. Path i belongs to pixel i // spp; bounces number them from 0."""
        bvh, offset, path = self.prepared.bvh, self.prepared.offset, np.arange(len(paths))
        origin, direction = camera_rays(self.view, (paths.start + path) // spp, uniforms(seed, 0, paths)[:, :2])
        hits = search(bvh, origin, direction)
        for depth in range(1, max_bounces + 1):
            path, points = path[hits.found], points_at(self.prepared, hits, direction)
            shiny = np.flatnonzero(self.glossy[points.part])
            random = uniforms(seed, depth, paths)[path]
            to_light, direction = self.emitter.sample(random[:, :2]), scattering.sample(points, shiny, random[:, 2:])
            shadow = search(bvh, points.leave(to_light, offset), to_light, any_hit=True)
            hits = search(bvh, points.leave(direction, offset), direction, any_hit=depth == max_bounces)
            scattered = [scattering.scatter(points, shiny, drawn) for drawn in (to_light, direction)]
            gathered = (
                _gather(self.emitter, scattered[0], shiny, to_light, ~shadow.found),
                _gather(self.emitter, scattered[1], shiny, direction, ~hits.found),
            )
            yield _bounce(path, points, shiny, scattered, gathered)


def camera_rays(
    view: View, pixel: Int[ndarray, " rays"], random: Float[ndarray, "rays 2"]
) -> tuple[Float[ndarray, "rays 3"], Float[ndarray, "rays 3"]]:
    """Origins and unit directions of rays through pixels (row * width + column), placed within each by `random`."""
    row, col = np.divmod(pixel, view.width)
    extent = math.tan(view.camera.vertical_fov / 2.0)
    x = (2.0 * (col + random[:, 0]) - view.width) / view.height * extent
    y = (1.0 - 2.0 * (row + random[:, 1]) / view.height) * extent
    direction = np.stack([x, y, np.full_like(x, -1.0)], axis=-1) @ view.camera.basis()
    direction /= np.linalg.norm(direction, axis=-1, keepdims=True)
    return np.broadcast_to(np.asarray(view.camera.origin, dtype=np.float64), direction.shape), direction


def uniforms(seed: int, depth: int, paths: range) -> Float[ndarray, "paths 4"]:
    """Four numbers in [0, 1) for each path at each depth, the same however paths are grouped into chunks.

    Philox is a function of a key and a counter (Salmon et al. 2011): seed and depth are the key, the path the counter.
    """
    key = np.array([seed % 2**64, depth], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=paths.start)).random((len(paths), 4))


def _gather(
    emitter: EnvironmentEmitter,
    scattered: Scattering,
    shiny: Int[ndarray, " glossy"],
    direction: Float[ndarray, "points 3"],
    visible: Bool[ndarray, " points"],
) -> tuple[Taps, Taps]:
    """The light from these directions, reflected diffusely and as gloss, weighted by the balance heuristic.

    It weights a sample of density p_i by p_i / (p_1 + p_2), so f / p_i becomes f / (p_1 + p_2) for both (Veach 1995).
    """
    taps, density = emitter.taps(direction), emitter.pdf(direction) + scattered.density
    counts = visible & (scattered.density > 0.0)
    diffuse = _ratio(scattered.diffuse, density, counts)
    gloss = _ratio(scattered.gloss, density[shiny], counts[shiny])
    return taps.scaled(diffuse), taps.at(shiny).scaled(gloss)


def _bounce(
    path: Int[ndarray, " points"],
    points: Points,
    shiny: Int[ndarray, " glossy"],
    scattered: Sequence[Scattering],
    gathered: Sequence[tuple[Taps, Taps]],
) -> Bounce:
    """The record of these vertices. The paths go on along the second of the two directions."""
    (to_light, onward), (diffuse, gloss) = scattered, zip(*gathered, strict=True)
    in_front = onward.density > 0.0
    diffuse_onward = _ratio(onward.diffuse, onward.density, in_front)
    gloss_onward = _ratio(onward.gloss, onward.density[shiny], in_front[shiny])
    return Bounce(
        path,
        points.part,
        points.uv,
        Reflection(np.arange(len(path)), Taps.summed(diffuse), diffuse_onward),
        (
            Gloss(to_light.cosines, Reflection(shiny, gloss[0], np.zeros(len(shiny)))),
            Gloss(onward.cosines, Reflection(shiny, gloss[1], gloss_onward)),
        ),
    )


def _ratio(
    value: Float[ndarray, " points"], density: Float[ndarray, " points"], counts: Bool[ndarray, " points"]
) -> Float[ndarray, " points"]:
    return np.divide(value, density, out=np.zeros_like(value), where=counts)
