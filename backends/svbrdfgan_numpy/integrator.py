"""Paths from the camera over the surface to the light.

Paths depend on geometry, light, and those maps that say how a point scatters, but never on the base colour. So with a
fixed seed a picture is a smooth function of the base colour, and its derivative is exactly that of the estimator; for
other maps and the light, directions and their densities count as constants.

At each vertex a path gathers light from two directions, one drawn where the light is bright and one as the surface
scatters. The path goes on along the second, if it meets something there. `shading.Bounce` holds what a path carries.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import View
from svbrdfgan_numpy.bsdf import Bsdf
from svbrdfgan_numpy.bvh import Hits, search
from svbrdfgan_numpy.environment import EnvironmentEmitter
from svbrdfgan_numpy.materials import MaterialPoints
from svbrdfgan_numpy.shading import Arrival, Bounce
from svbrdfgan_numpy.surface import Points, PreparedSurface, points_at
from svbrdfgan_numpy.textures import Texture
from svbrdfgan_numpy.transparency import RayNumbers
from svbrdfgan_numpy.vectors import dot


@dataclass(frozen=True, eq=False)
class PathTracer:
    """Everything that paths depend on."""

    prepared: PreparedSurface
    emitter: EnvironmentEmitter
    view: View
    maps: Mapping[str, Texture]

    def trace(self, paths: range, *, spp: int, seed: int, max_bounces: int) -> Iterator[Bounce]:
        """The bounces of some paths, first to last. Path i belongs to pixel i // spp; bounces number them from 0."""
        offset, path = self.prepared.offset, np.arange(len(paths))
        origin, direction = camera_rays(self.view, (paths.start + path) // spp, uniforms(seed, 0, paths)[:, :2])
        hits = self._search(origin, direction, RayNumbers(seed, 0, paths.start + path))
        for depth in range(1, max_bounces + 1):
            path, points = path[hits.found], points_at(self.prepared, hits, direction)
            vertices = MaterialPoints.of(self.prepared, points, self.maps)
            bsdf, random = vertices.bsdf(self.maps), uniforms(seed, depth, paths)[path]
            to_light, direction = self.emitter.sample(random[:, :2]), bsdf.sample(points.outgoing, random[:, 2:])
            rays = [RayNumbers(seed, 2 * depth + second, paths.start + path) for second in (0, 1)]
            shadow = self._search(points.leave(to_light, offset), to_light, rays[0], any_hit=True)
            hits = self._search(points.leave(direction, offset), direction, rays[1], any_hit=depth == max_bounces)
            arrivals = (
                self._arrival(points, bsdf, to_light, ~shadow.found, onward=False),
                self._arrival(points, bsdf, direction, ~hits.found, onward=True),
            )
            yield Bounce(path, vertices, arrivals)

    def _search(
        self,
        origin: Float[ndarray, "rays 3"],
        direction: Float[ndarray, "rays 3"],
        rays: RayNumbers,
        *,
        any_hit: bool = False,
    ) -> Hits:
        """The first hits that the rays do not pass through; with `any_hit`, any of these."""
        if self.prepared.transparency is None:
            return search(self.prepared.bvh, origin, direction, any_hit=any_hit)
        stops = self.prepared.transparency.stops(rays)
        return search(self.prepared.bvh, origin, direction, any_hit=any_hit, stops=stops)

    def _arrival(
        self,
        points: Points,
        bsdf: Bsdf,
        direction: Float[ndarray, "points 3"],
        visible: Bool[ndarray, " points"],
        *,
        onward: bool,
    ) -> Arrival:
        """The light from these directions, weighted by the balance heuristic.

        The heuristic weights a sample of density p_i by p_i / (p_1 + p_2), so f / p_i becomes f / (p_1 + p_2) for both
        (Veach 1995). Light from behind the surface does not count, even where it is in front of a tilted normal.
        """
        density = bsdf.pdf(points.outgoing, direction)
        counts = (density > 0.0) & (dot(points.normal, direction) > 0.0)
        gathered = _inverse(self.emitter.pdf(direction) + density, counts & visible)
        weight = _inverse(density, counts) if onward else np.zeros_like(density)
        return Arrival(direction, self.emitter.taps(direction).scaled(gathered), weight)


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


def _inverse(density: Float[ndarray, " points"], counts: Bool[ndarray, " points"]) -> Float[ndarray, " points"]:
    return np.divide(1.0, density, out=np.zeros_like(density), where=counts)
