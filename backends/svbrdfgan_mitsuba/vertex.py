"""Paths from the camera over the surface to the light, vertex by vertex, many at once.

At each vertex a path gathers light from two directions, one drawn where the light is bright and one as the surface
reflects; along the second it goes on, if something is there. With e_k the light gathered at the k-th vertex and sent
on towards the camera, and f_k the share that the vertex sends on of what arrives along the path, a path carries
e_0 + f_0 (e_1 + f_1 (e_2 + ...)).

Where a path goes is not differentiated. What it reads on its way is: maps and radiance, as plain values at its
vertices. From there to the texels leads the transpose of the lookup.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from svbrdfgan_mitsuba.film import Run
from svbrdfgan_mitsuba.jit import dr
from svbrdfgan_mitsuba.light import Light
from svbrdfgan_mitsuba.reflection import Dielectric, Lambertian, Reflection
from svbrdfgan_mitsuba.scene import Lens, PreparedSurface
from svbrdfgan_mitsuba.textures import Maps, Taps

OFFSET = 2e-5
"""How far rays start from the surface, which lies in the unit sphere. Mitsuba itself takes up to ten times as much:
light then comes through narrow gaps, and the environment's gradient at a real car was 0.04 % too large."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Camera samples of neighbouring pixels, and the chances that they take.

    Numbers are a function of seed, pixel, sample, depth (Philox, Salmon et al. 2011): the same however a film is cut.
    """

    mi: Any
    seed: Any
    pixel: Any
    sample: Any

    @classmethod
    def of(cls, mi: Any, run: Run) -> Samples:
        """All those of a run, pixel by pixel."""
        index, each = dr.arange(mi.UInt32, run.pixels * run.spp), dr.opaque(mi.UInt32, run.spp)
        pixel, seed = index // each, dr.opaque(mi.UInt64, run.seed % 2**64)
        return cls(mi, seed, pixel + dr.opaque(mi.UInt32, run.first), index - pixel * each)

    def chances(self, depth: int) -> Any:
        """A generator for each sample."""
        return self.mi.Philox4x32(self.seed, self.pixel, self.sample, dr.opaque(self.mi.UInt32, depth))


@dataclass(frozen=True, eq=False)
class Hits:
    """Rays, and what they met first."""

    ray: Any
    found: Any
    met: Any


@dataclass(frozen=True, eq=False)
class Values:
    """What is read at many vertices.

    Attributes:
        roughness: None if no part has one.
        radiance: of the light, in the two directions.
    """

    base_color: Any
    roughness: Any | None
    radiance: tuple[Any, Any]


@dataclass(frozen=True, eq=False)
class Vertex:
    """Where paths are at one depth, what they read there, and where they go.

    Attributes:
        found: whether there is a vertex.
        part: of the surface.
        color, rough, lights: where its values are read.
        glossy: whether the part has a roughness.
        viewer, directions: towards the previous vertex, and the two of the light, in the shading frame.
        weight: of the light from the two directions, by the balance heuristic; zero where it does not arrive.
        onward: 1 / density of the second direction where something lies there, else zero.
        hits: what lies there; None at the last vertex.
    """

    found: Any
    part: Any
    uv: Any
    color: Taps
    rough: Taps | None
    lights: tuple[Taps, Taps]
    glossy: Any
    viewer: Any
    directions: tuple[Any, Any]
    weight: tuple[Any, Any]
    onward: Any
    hits: Hits | None
    values: Values


@dataclass(frozen=True, eq=False)
class Tracer:
    """All that paths depend on, the samples excepted."""

    prepared: PreparedSurface
    lens: Lens
    light: Light
    maps: Maps

    @property
    def mi(self) -> Any:
        return self.prepared.mi

    def start(self, samples: Samples) -> Hits:
        """What the camera sees."""
        random = samples.chances(0).next_float32x4()
        return self._search(self.lens.ray(samples.pixel, self.mi.Point2f(random.x, random.y)), True, coherent=True)

    def meet(self, hits: Hits, samples: Samples, depth: int, last: bool) -> Vertex:
        """The vertices where the rays hit."""
        mi, found, scene = self.mi, hits.found, self.prepared.scene
        point = self.prepared.mesh.compute_surface_interaction(hits.ray, hits.met, active=found)
        part = dr.gather(mi.UInt32, self.prepared.face_part, hits.met.prim_index, found)
        uv = dr.select(found, point.uv, mi.Point2f(0.0))  # finite where there is nothing, like what follows
        color, _ = self.maps.color.taps(mi, part, uv, found)
        base_color = color.read(mi.Color3f, self.maps.color.texels)
        rough = glossy = roughness = None
        if self.maps.rough:
            rough, glossy = self.maps.rough.taps(mi, part, uv, found)
            roughness = rough.read(mi.Float, self.maps.rough.texels)

        frame = mi.Frame3f(dr.select(found, _facing(point, hits.ray.d), -hits.ray.d))
        viewer = frame.to_local(-hits.ray.d)
        reflection = self._reflection(base_color, roughness, glossy, viewer)
        numbers = samples.chances(depth)
        random, (number, choice, _, _) = numbers.next_float32x4(), numbers.next_uint32x4()
        to_light = self.light.sample(number, mi.Point2f(random.x, random.y))
        away = reflection.sample(mi.Float(choice) * 2.0**-32, mi.Point2f(random.z, random.w))
        local, world = (frame.to_local(to_light), away), (to_light, frame.to_world(away))

        rays = [_leaving(mi, point, direction) for direction in world]
        up = [found & (direction.z > 0.0) for direction in local]
        onward = None if last else self._search(rays[1], up[1])
        blocked = (scene.ray_test(rays[0], up[0]), onward.found if onward else scene.ray_test(rays[1], up[1]))
        looks = [self.light.look(direction, above) for direction, above in zip(world, up, strict=True)]
        densities = [reflection.density(direction) for direction in local]
        weight = [
            dr.select(above & ~hidden, 1.0 / (density + look[2]), 0.0)
            for above, hidden, density, look in zip(up, blocked, densities, looks, strict=True)
        ]
        return Vertex(
            found=found,
            part=part,
            uv=uv,
            color=color,
            rough=rough,
            lights=(looks[0][0], looks[1][0]),
            glossy=glossy,
            viewer=viewer,
            directions=local,
            weight=(weight[0], weight[1]),
            onward=dr.select(up[1] & blocked[1] & (densities[1] > 0.0), 1.0 / densities[1], 0.0),
            hits=onward,
            values=Values(base_color, roughness, (looks[0][1], looks[1][1])),
        )

    def shade(self, vertex: Vertex, values: Values) -> tuple[Any, Any]:
        """The light gathered and sent on, and the share sent on of what arrives along the path. Differentiable."""
        reflection = self._reflection(values.base_color, values.roughness, vertex.glossy, vertex.viewer)
        value = [reflection.value(direction) for direction in vertex.directions]
        gathered = value[0] * values.radiance[0] * vertex.weight[0] + value[1] * values.radiance[1] * vertex.weight[1]
        return gathered, value[1] * vertex.onward

    def _reflection(self, base_color: Any, roughness: Any, glossy: Any, viewer: Any) -> Reflection:
        if roughness is None:
            return Lambertian(self.mi, base_color)
        return Dielectric(self.mi, base_color, roughness, glossy, viewer)

    def _search(self, ray: Any, active: Any, coherent: bool = False) -> Hits:
        met = self.prepared.scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
        return Hits(ray, met.is_valid(), met)


def _leaving(mi: Any, point: Any, direction: Any) -> Any:
    """Rays from points of the surface, which start a little off it, on the side that they go to."""
    away = dr.mulsign(OFFSET, dr.dot(point.n, direction))
    return mi.Ray3f(dr.fma(point.n, away, point.p), direction)


def _facing(point: Any, direction: Any) -> Any:
    """The shading normal, turned to the side that the ray came from; the face's own where there is none."""
    normal = point.sh_frame.n
    normal = dr.select(dr.squared_norm(normal) > 0.5, normal, point.n)
    return dr.select(dr.dot(normal, direction) > 0.0, -normal, normal)
