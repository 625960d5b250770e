"""Renderers on the slow one, which can be bent: bounces, shadows and gloss."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any

from svbrdfgan_numpy import integrator
from svbrdfgan_numpy.bvh import Hits

from svbrdfgan.types import Gradients, Material, Materials
from wrong.base import Call, OnNumpy, Patch, Patched, gradient_of, slow_renderer
from wrong.table import caught_by


@caught_by("test_direct_light_takes_no_colour_from_other_parts")
class BouncesOnceMore(OnNumpy):
    """It counts bounces from zero."""

    bounces, claims = 2, MappingProxyType({"max_bounces": 1, "transport": False})


@caught_by(
    "test_light_bounces_as_often_as_declared", "test_interreflection_as_numpy", reason="Twice in the same sense."
)
class BouncesOnceLess(OnNumpy):
    """It counts the camera as a bounce."""

    bounces, claims = 1, MappingProxyType({"max_bounces": 2, "transport": False})


@caught_by("test_a_lid_casts_a_shadow_and_only_there", whole=True)
class WithoutShadows(Patched):
    """Light arrives whatever is in its way."""

    def patches(self) -> list[Patch]:
        right = integrator.search

        def search(bvh: Any, origin: Any, direction: Any, *, any_hit: bool = False, **stops: Any) -> Hits:
            return Hits.none(len(origin)) if any_hit else right(bvh, origin, direction, **stops)

        return [(integrator, "search", search)]


@caught_by(
    "test_gloss_shines_at_the_mirror_angle",
    "test_gloss_in_uniform_light_is_the_formulas",
    "test_smooth_is_bounded",
    "test_roughness_maps_lie_as_textures",
    "test_roughness_below_its_bound_has_no_gradient",
    whole=True,
    reason="All look at how rough it is.",
)
class RoughnessIsAlpha(OnNumpy):
    """Alpha is roughness, not its square."""

    def asked(self, call: Call) -> Call:
        def misread(material: Material) -> Material:
            maps = dict(material.maps)
            if "roughness" in maps:
                maps["roughness"] = maps["roughness"].detach().clamp_min(0.0) ** 0.5
            return Material(maps)

        return replace(call, materials=Materials(tuple(misread(material) for material in call.materials.parts)))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        parts = []
        for part, material in zip(gradients.materials, call.materials.parts, strict=True):
            found = dict(part)
            if "roughness" in found:
                found["roughness"] = found["roughness"] * 0.5 / material.maps["roughness"].detach() ** 0.5
            parts.append(found)
        return replace(gradients, materials=tuple(parts))


@caught_by("test_roughness_gradients_of_gloss", whole=True, late=True)
class RoughnessGradientTooSteep(OnNumpy):
    """The gradient of roughness is 10 % too large."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradient_of(gradients, "roughness", lambda gradient: 1.1 * gradient)


@caught_by("test_roughness_gradients_of_gloss", "test_roughness_gradients_of_whole_materials", whole=True)
class RoughnessGradientOfAlpha(OnNumpy):
    """The gradient of roughness is that of alpha, its square."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        parts = [
            {n: v * 0.5 / material.maps[n].detach() if n == "roughness" else v for n, v in part.items()}
            for part, material in zip(gradients.materials, call.materials.parts, strict=True)
        ]
        return replace(gradients, materials=tuple(parts))


@caught_by("test_base_color_where_parts_light_one_another")
class GradientOfDirectLight(OnNumpy):
    """Gradients take one bounce, and pictures two."""

    bounces = 2

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return replace(gradients, materials=self.vjp(call, slow_renderer(1)).materials)
