"""Rays and what they meet first; they pass through parts that are not opaque by chance (`docs/conventions.md`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from svbrdfgan_mitsuba.interop import dr
from svbrdfgan_mitsuba.prepared_scene import PreparedSurface
from svbrdfgan_mitsuba.textures import Atlas

OFFSET = 2e-5
"""Distance from the surface, which lies in the unit sphere, at which a leaving ray starts. Mitsuba's own is up to ten
times as large: light leaks through narrow gaps, and the environment's gradient at a real car was 0.04 % too large."""

POINTS = 64
"""The point that a ray does not pass, even if it is transparent, counted from where the ray starts."""


@dataclass(frozen=True, eq=False)
class Hits:
    """Rays and where they end, as Mitsuba's preliminary intersection records.

    Attributes:
        ray: it starts behind the last transparent point that was passed.
    """

    ray: Any
    found: Any
    intersection: Any


def first_hits(prepared: PreparedSurface, ray: Any, active: Any, number: Any, coherent: bool = False) -> Hits:
    """The hits at which rays end; `number` is a random integer for each ray, used only where a part is not opaque."""
    if prepared.alpha is not None:
        return _first_not_passed(prepared, prepared.alpha, ray, active, number, coherent)
    found = prepared.scene.ray_intersect_preliminary(ray, coherent=coherent, active=active)
    return Hits(ray, found.is_valid(), found)


def blocked(prepared: PreparedSurface, ray: Any, active: Any, number: Any) -> Any:
    """Whether anything stops the rays."""
    if prepared.alpha is not None:
        return first_hits(prepared, ray, active, number).found
    return prepared.scene.ray_test(ray, active)


def leaving(mi: Any, point: Any, direction: Any) -> Any:
    """Rays from points of the surface, started a little off it on the side that they go to."""
    away = dr.mulsign(OFFSET, dr.dot(point.n, direction))
    return mi.Ray3f(dr.fma(point.n, away, point.p), direction)


def _first_not_passed(
    prepared: PreparedSurface, alpha: Atlas, ray: Any, active: Any, number: Any, coherent: bool
) -> Hits:
    mi, nothing = prepared.mi, dr.zeros(prepared.mi.PreliminaryIntersection3f, dr.width(ray))
    nothing.t = dr.full(mi.Float, dr.inf, dr.width(ray))
    state = (mi.Point3f(ray.o), nothing, mi.Bool(active), mi.UInt32(0))

    def unfinished(origin: Any, found: Any, going: Any, step: Any) -> Any:
        return going

    def advanced(origin: Any, found: Any, going: Any, step: Any) -> tuple[Any, ...]:
        onward = mi.Ray3f(origin, ray.d)
        found = prepared.scene.ray_intersect_preliminary(onward, coherent=coherent, active=going)
        hit = going & found.is_valid()
        point = prepared.mesh.compute_surface_interaction(onward, found, active=hit)
        part = dr.gather(mi.UInt32, prepared.face_part, found.prim_index, hit)
        ends = alpha.taps(mi, part, point.uv, hit)[0].read(mi.Float, alpha.texels)
        passes = hit & (step < POINTS - 1) & (mi.sample_tea_float32(number, step) >= ends)
        return dr.select(passes, leaving(mi, point, ray.d).o, origin), found, passes, step + 1

    origin, found, _, _ = dr.while_loop(state, unfinished, advanced)
    return Hits(mi.Ray3f(origin, ray.d), found.is_valid(), found)
