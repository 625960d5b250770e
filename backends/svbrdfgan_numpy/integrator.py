"""Paths: from the camera over the surface to the light.

They depend on geometry, light and which parts gloss, never on the values of maps: with the same seed a picture is a
smooth function of those values, and its derivative is exactly that of the estimator.

At each of its vertices a path gathers light from two directions, one drawn where the light is bright and one as the
surface reflects; along the second it goes on, if something is there. `bounce.Reflection` says what it carries.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.types import View
from svbrdfgan_numpy import scattering
from svbrdfgan_numpy.bounce import Bounce, Gloss, Reflection
from svbrdfgan_numpy.bvh import search
from svbrdfgan_numpy.camera import camera_rays
from svbrdfgan_numpy.environment import Light
from svbrdfgan_numpy.scattering import Scattering
from svbrdfgan_numpy.surface import Points, PreparedSurface, points_at
from svbrdfgan_numpy.taps import Taps


@dataclass(frozen=True, eq=False)
class Scene:
    """All that paths depend on.

    Attributes:
        glossy: whether the material of each part has `roughness`.
    """

    prepared: PreparedSurface
    light: Light
    view: View
    glossy: Bool[ndarray, " parts"]


def trace_paths(scene: Scene, paths: range, *, spp: int, seed: int, max_bounces: int) -> Iterator[Bounce]:
    """The bounces of some paths, first to last. Path i belongs to pixel i // spp; bounces number them from 0."""
    bvh, offset, path = scene.prepared.bvh, scene.prepared.offset, np.arange(len(paths))
    origin, direction = camera_rays(scene.view, (paths.start + path) // spp, uniforms(seed, 0, paths)[:, :2])
    hits = search(bvh, origin, direction)
    for depth in range(1, max_bounces + 1):
        path, points = path[hits.found], points_at(scene.prepared, hits, direction)
        shiny = np.flatnonzero(scene.glossy[points.part])
        random = uniforms(seed, depth, paths)[path]
        to_light, direction = scene.light.sample(random[:, :2]), scattering.sample(points, shiny, random[:, 2:])
        shadow = search(bvh, points.leave(to_light, offset), to_light, any_hit=True)
        hits = search(bvh, points.leave(direction, offset), direction, any_hit=depth == max_bounces)
        scattered = [scattering.scatter(points, shiny, drawn) for drawn in (to_light, direction)]
        gathered = (
            _gather(scene.light, scattered[0], shiny, to_light, ~shadow.found),
            _gather(scene.light, scattered[1], shiny, direction, ~hits.found),
        )
        yield _bounce(path, points, shiny, scattered, gathered)


def uniforms(seed: int, depth: int, paths: range) -> Float[ndarray, "paths 4"]:
    """Four numbers in [0, 1) for each path at each depth, the same whichever paths are asked for together.

    Philox is a function of a key and a counter (Salmon et al. 2011): seed and depth are the key, the path the counter.
    """
    key = np.array([seed % 2**64, depth], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key, counter=paths.start)).random((len(paths), 4))


def _gather(
    light: Light,
    scattered: Scattering,
    shiny: Int[ndarray, " glossy"],
    direction: Float[ndarray, "points 3"],
    visible: Bool[ndarray, " points"],
) -> tuple[Taps, Taps]:
    """The light from directions drawn by either strategy, combined by the balance heuristic: diffuse, and gloss.

    It weighs a sample of density p_i by p_i / (p_1 + p_2), so f / p_i becomes f / (p_1 + p_2) for both (Veach 1995).
    """
    taps, density = light.taps(direction), light.pdf(direction) + scattered.density
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
    """What the paths keep of these points. They go on along the second of both directions."""
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
