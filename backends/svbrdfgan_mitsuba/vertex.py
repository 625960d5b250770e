"""The vertices of many paths at once: where they are, the light that they gather, and where the paths go on.

At each vertex a path gathers light from two directions, one drawn where the light is bright and one as the surface
reflects. Along the second it goes on, if it hits something there. With e_k the light gathered at the k-th vertex and
reflected towards the camera, and f_k the factor of the light that arrives along the path, a path carries
e_0 + f_0 (e_1 + f_1 (e_2 + ...)).

The geometry of a path is not differentiated: directions and densities are detached. What it reads at its vertices is:
maps and radiance, as plain values. The transposed lookup carries their gradients on to the texels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from svbrdfgan_mitsuba.bsdf import Bsdf, Dielectric, Lambertian
from svbrdfgan_mitsuba.environment import EnvironmentEmitter
from svbrdfgan_mitsuba.interop import dr
from svbrdfgan_mitsuba.scene import CameraSamples, PreparedCamera, PreparedSurface
from svbrdfgan_mitsuba.textures import MaterialMaps, Taps

OFFSET = 2e-5
"""How far from the surface, which lies in the unit sphere, a leaving ray starts. Mitsuba's own offset is up to ten
times as large: light leaks through narrow gaps, and the environment's gradient at a real car was 0.04 % too large."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Rays and their first intersections, as Mitsuba's preliminary intersection records."""

    ray: Any
    found: Any
    intersection: Any


@dataclass(frozen=True, eq=False)
class VertexValues:
    """The differentiable values at many vertices.

    Attributes:
        roughness: None if no part has one.
        radiance: of the environment, in each of the two directions.
    """

    base_color: Any
    roughness: Any | None
    radiance: tuple[Any, Any]


@dataclass(frozen=True, eq=False)
class Vertex:
    """The vertices of paths at one depth, what they read, and where they go on.

    Attributes:
        found: whether the path has a vertex at this depth.
        part: of the surface.
        color_taps, roughness_taps, radiance_taps: the lookups behind `values`.
        glossy: whether the part has a roughness.
        viewer, directions: to the previous vertex, and the two light directions, in the shading frame.
        weight: of the light from the two directions, by the balance heuristic; zero where none arrives.
        onward: 1 / density of the second direction where it hits the surface, else zero.
        hits: the hits along the second direction; None at the last vertex.
    """

    found: Any
    part: Any
    uv: Any
    color_taps: Taps
    roughness_taps: Taps | None
    radiance_taps: tuple[Taps, Taps]
    glossy: Any
    viewer: Any
    directions: tuple[Any, Any]
    weight: tuple[Any, Any]
    onward: Any
    hits: Hits | None
    values: VertexValues


@dataclass(frozen=True, eq=False)
class PathTracer:
    """Everything that paths depend on, except the samples."""

    prepared: PreparedSurface
    camera: PreparedCamera
    emitter: EnvironmentEmitter
    maps: MaterialMaps

    @property
    def mi(self) -> Any:
        return self.prepared.mi

    def camera_hits(self, samples: CameraSamples) -> Hits:
        """The first hits of the camera rays."""
        random = samples.rng(0).next_float32x4()
        return self._intersect(self.camera.rays(samples.pixel, self.mi.Point2f(random.x, random.y)), True, True)

    def vertex(self, hits: Hits, samples: CameraSamples, depth: int, last: bool) -> Vertex:
        """The vertices at the hits, with two light directions drawn at each."""
        mi, found, scene = self.mi, hits.found, self.prepared.scene
        point = self.prepared.mesh.compute_surface_interaction(hits.ray, hits.intersection, active=found)
        part = dr.gather(mi.UInt32, self.prepared.face_part, hits.intersection.prim_index, found)
        uv = dr.select(found, point.uv, mi.Point2f(0.0))  # finite for misses too, as all that follows must be
        color_taps, _ = self.maps.base_color.taps(mi, part, uv, found)
        base_color = color_taps.read(mi.Color3f, self.maps.base_color.texels)
        roughness_taps = glossy = roughness = None
        if self.maps.roughness:
            roughness_taps, glossy = self.maps.roughness.taps(mi, part, uv, found)
            roughness = roughness_taps.read(mi.Float, self.maps.roughness.texels)

        frame = mi.Frame3f(dr.select(found, _facing(point, hits.ray.d), -hits.ray.d))
        viewer = frame.to_local(-hits.ray.d)
        bsdf = self._bsdf(base_color, roughness, glossy, viewer)
        rng = samples.rng(depth)
        random, (number, choice, _, _) = rng.next_float32x4(), rng.next_uint32x4()
        to_light = self.emitter.sample(number, mi.Point2f(random.x, random.y))
        away = bsdf.sample(mi.Float(choice) * 2.0**-32, mi.Point2f(random.z, random.w))
        local, world = (frame.to_local(to_light), away), (to_light, frame.to_world(away))

        rays = [_leaving(mi, point, direction) for direction in world]
        above = [found & (direction.z > 0.0) for direction in local]
        onward = None if last else self._intersect(rays[1], above[1])
        blocked = (
            scene.ray_test(rays[0], above[0]),
            onward.found if onward else scene.ray_test(rays[1], above[1]),
        )
        lookups = [self.emitter.evaluate(direction, up) for direction, up in zip(world, above, strict=True)]
        densities = [bsdf.density(direction) for direction in local]
        weight = [
            dr.select(up & ~hidden, 1.0 / (density + lookup[2]), 0.0)
            for up, hidden, density, lookup in zip(above, blocked, densities, lookups, strict=True)
        ]
        return Vertex(
            found=found,
            part=part,
            uv=uv,
            color_taps=color_taps,
            roughness_taps=roughness_taps,
            radiance_taps=(lookups[0][0], lookups[1][0]),
            glossy=glossy,
            viewer=viewer,
            directions=local,
            weight=(weight[0], weight[1]),
            onward=dr.select(above[1] & blocked[1] & (densities[1] > 0.0), 1.0 / densities[1], 0.0),
            hits=onward,
            values=VertexValues(base_color, roughness, (lookups[0][1], lookups[1][1])),
        )

    def shade(self, vertex: Vertex, values: VertexValues) -> tuple[Any, Any]:
        """The light gathered and reflected to the viewer, and the factor of light along the path; differentiable."""
        bsdf = self._bsdf(values.base_color, values.roughness, vertex.glossy, vertex.viewer)
        value = [bsdf.value(direction) for direction in vertex.directions]
        gathered = value[0] * values.radiance[0] * vertex.weight[0] + value[1] * values.radiance[1] * vertex.weight[1]
        return gathered, value[1] * vertex.onward

    def _bsdf(self, base_color: Any, roughness: Any, glossy: Any, viewer: Any) -> Bsdf:
        if roughness is None:
            return Lambertian(self.mi, base_color)
        return Dielectric(self.mi, base_color, roughness, glossy, viewer)

    def _intersect(self, ray: Any, active: Any, coherent: bool = False) -> Hits:
        found = self.prepared.scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
        return Hits(ray, found.is_valid(), found)


def _leaving(mi: Any, point: Any, direction: Any) -> Any:
    """Rays from points of the surface, started a little off it on the side that they go to."""
    away = dr.mulsign(OFFSET, dr.dot(point.n, direction))
    return mi.Ray3f(dr.fma(point.n, away, point.p), direction)


def _facing(point: Any, direction: Any) -> Any:
    """The shading normal, turned to the side that the ray came from; the face's normal where corner normals cancel."""
    normal = point.sh_frame.n
    normal = dr.select(dr.squared_norm(normal) > 0.5, normal, point.n)
    return dr.select(dr.dot(normal, direction) > 0.0, -normal, normal)
