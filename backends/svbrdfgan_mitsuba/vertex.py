"""The vertices of many paths at once: where they are, the light that they gather, and where the paths go on.

At each vertex a path gathers light from two directions, one drawn where the light is bright and one as the surface
reflects. The path goes on along the second, if it hits something there. With e_k the light gathered at the k-th vertex
and reflected towards the camera, and f_k the factor of the light that arrives along the path, a path carries
e_0 + f_0 (e_1 + f_1 (e_2 + ...)).

The geometry of a path is not differentiated: directions and densities are detached. The maps and the radiance that a
path reads at its vertices are differentiated, as plain values; the transposed lookup carries their gradients on to the
texels.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from svbrdfgan_mitsuba.bsdf import Bsdf, Lambertian, MetallicRoughness, cosine
from svbrdfgan_mitsuba.environment import EnvironmentEmitter
from svbrdfgan_mitsuba.interop import dr
from svbrdfgan_mitsuba.normal_map import tilted_normal
from svbrdfgan_mitsuba.prepared_scene import CameraSamples, PreparedCamera, PreparedSurface
from svbrdfgan_mitsuba.rays import Hits, blocked, first_hits, leaving
from svbrdfgan_mitsuba.textures import Lookup, MaterialMaps, Taps


@dataclass(frozen=True, eq=False)
class VertexValues:
    """The differentiable values at many vertices.

    Attributes:
        maps: as read, by their names; only those that some part has.
        radiance: of the environment, in each of the two directions.
    """

    maps: Mapping[str, Any]
    radiance: tuple[Any, Any]


@dataclass(frozen=True, eq=False)
class Vertex:
    """The vertices of paths at one depth, what they read, and where they go on.

    Attributes:
        found: whether the path has a vertex at this depth.
        part: of the surface.
        lookups, radiance_taps: what is behind `values`.
        behind: whether the viewer is behind the surface, so that the shading normal was turned.
        viewer, directions: to the previous vertex, and the two light directions, in the shading frame: its z axis is
            the turned normal and, where there are normal maps, its x axis is the tangent.
        weight: of the light from the two directions, by the balance heuristic; zero where none arrives, or only from
            below the horizon of the shading normal.
        onward: 1 / density of the second direction where it hits the surface, else zero.
        hits: the hits along the second direction; None at the last vertex.
    """

    found: Any
    part: Any
    uv: Any
    lookups: Mapping[str, Lookup]
    radiance_taps: tuple[Taps, Taps]
    behind: Any
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
        rng = samples.rng(0)
        random = rng.next_float32x4()
        passing = None if self.prepared.alpha is None else rng.next_uint32x4().x
        ray = self.camera.rays(samples.pixel, self.mi.Point2f(random.x, random.y))
        return first_hits(self.prepared, ray, True, passing, coherent=True)

    def vertex(self, hits: Hits, samples: CameraSamples, depth: int, last: bool) -> Vertex:
        """The vertices at the hits, with two light directions drawn at each."""
        mi, found = self.mi, hits.found
        point = self.prepared.mesh.compute_surface_interaction(hits.ray, hits.intersection, active=found)
        part = dr.gather(mi.UInt32, self.prepared.face_part, hits.intersection.prim_index, found)
        uv = dr.select(found, point.uv, mi.Point2f(0.0))  # finite for misses too, as all that follows must be
        lookups = self.maps.lookups(mi, part, uv, found)
        values = {name: lookup.value for name, lookup in lookups.items()}

        frame, behind = self._frame(hits, point)
        viewer = frame.to_local(-hits.ray.d)
        normal = self._normal(values, lookups, behind, viewer)
        bsdf = self._bsdf(values, lookups, normal, viewer)
        rng = samples.rng(depth)
        random, (number, choice, *passing) = rng.next_float32x4(), rng.next_uint32x4()
        to_light = self.emitter.sample(number, mi.Point2f(random.x, random.y))
        away = bsdf.sample(mi.Float(choice) * 2.0**-32, mi.Point2f(random.z, random.w))
        local, world = (frame.to_local(to_light), away), (to_light, frame.to_world(away))

        rays = [leaving(mi, point, direction) for direction in world]
        above = [found & (direction.z > 0.0) for direction in local]
        if normal is not None:
            above = [up & (cosine(normal, direction) > 0.0) for up, direction in zip(above, local, strict=True)]
        onward = None if last else first_hits(self.prepared, rays[1], above[1], passing[1])
        hidden = (
            blocked(self.prepared, rays[0], above[0], passing[0]),
            onward.found if onward else blocked(self.prepared, rays[1], above[1], passing[1]),
        )
        lights = [self.emitter.evaluate(direction, up) for direction, up in zip(world, above, strict=True)]
        densities = [bsdf.density(direction) for direction in local]
        weight = [
            dr.select(up & ~out, 1.0 / (density + light[2]), 0.0)
            for up, out, density, light in zip(above, hidden, densities, lights, strict=True)
        ]
        return Vertex(
            found=found,
            part=part,
            uv=uv,
            lookups=lookups,
            radiance_taps=(lights[0][0], lights[1][0]),
            behind=behind,
            viewer=viewer,
            directions=local,
            weight=(weight[0], weight[1]),
            onward=dr.select(above[1] & hidden[1] & (densities[1] > 0.0), 1.0 / densities[1], 0.0),
            hits=onward,
            values=VertexValues(values, (lights[0][1], lights[1][1])),
        )

    def shade(self, vertex: Vertex, values: VertexValues) -> tuple[Any, Any]:
        """The light gathered and reflected to the viewer, and the factor of light along the path; differentiable."""
        normal = self._normal(values.maps, vertex.lookups, vertex.behind, vertex.viewer)
        bsdf = self._bsdf(values.maps, vertex.lookups, normal, vertex.viewer)
        value = [bsdf.value(direction) for direction in vertex.directions]
        gathered = value[0] * values.radiance[0] * vertex.weight[0] + value[1] * values.radiance[1] * vertex.weight[1]
        return gathered, value[1] * vertex.onward

    def _frame(self, hits: Hits, point: Any) -> tuple[Any, Any]:
        """The frame of directions at the hits, and whether the viewer is behind the surface."""
        mi, found, direction = self.mi, hits.found, hits.ray.d
        normal = point.sh_frame.n
        normal = dr.select(dr.squared_norm(normal) > 0.5, normal, point.n)  # the face's, where corner normals cancel
        behind = dr.dot(normal, direction) > 0.0
        toward = dr.select(found, dr.select(behind, -normal, normal), -direction)
        if "normal" not in self.maps.atlases:
            return mi.Frame3f(toward), behind
        normal = dr.select(found, normal, toward)
        return self.prepared.tangents.at(hits.intersection, normal, toward, found), behind

    def _normal(self, values: Mapping[str, Any], lookups: Mapping[str, Lookup], behind: Any, viewer: Any) -> Any | None:
        """The normals that the lobes are about, in the shading frame; None for its z axis."""
        if "normal" not in values:
            return None
        return tilted_normal(self.mi, values["normal"], lookups["normal"].given, behind, viewer)

    def _bsdf(self, values: Mapping[str, Any], lookups: Mapping[str, Lookup], normal: Any, viewer: Any) -> Bsdf:
        if "roughness" not in values:
            return Lambertian(self.mi, values["base_color"], normal)
        return MetallicRoughness(
            mi=self.mi,
            base_color=values["base_color"],
            normal=normal,
            roughness=values["roughness"],
            metallic=values.get("metallic"),
            glossy=lookups["roughness"].given,
            viewer=viewer,
        )
