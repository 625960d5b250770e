"""Gloss and metal of other formulas, and directions drawn with another density than is divided by."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from svbrdfgan_numpy import bsdf, ggx, renderer

from svbrdfgan.types import Gradients
from wrong.base import Call, OnNumpy, Patch, Patched, gradient_of, with_map
from wrong.table import caught_by

Facets = bsdf._Facets


@caught_by(
    "test_metal_is_tinted",
    "test_metallic_mixes",
    whole=True,
)
class MetalWithoutTint(Patched):
    """Metal reflects all channels alike, by their mean."""

    def patches(self) -> list[Patch]:
        right = Facets.reflectance

        def grey(self: Any, color: Any, metallic: Any) -> Any:
            return right(self, np.broadcast_to(color.mean(axis=-1, keepdims=True), color.shape), metallic)

        return [(Facets, "reflectance", grey)]


@caught_by("test_metal_is_tinted", whole=True)
class MetalWithoutFresnel(Patched):
    """Metal reflects its base colour at all angles."""

    def patches(self) -> list[Patch]:
        def tinted(self: Any, color: Any, metallic: Any) -> Any:
            return (1.0 - metallic) * self.dielectric + metallic * color

        return [(Facets, "reflectance", tinted)]


@caught_by(
    "test_metal_has_no_diffuse_term",
    "test_metal_is_tinted",
    "test_metal_in_uniform_light_is_the_formulas",
    "test_metallic_mixes",
    "test_metallic_maps_lie_as_textures",
    "test_rims_are_not_black",
    whole=True,
    reason="All look at how bright metal is.",
)
class MetalAboveADiffuse(Patched):
    """Metal has its diffuse term as well."""

    def patches(self) -> list[Patch]:
        def both(self: Any, color: Any, metallic: Any) -> Any:
            return (1.0 - self.dielectric) * color / np.pi + self.reflectance(color, metallic) * self.specular

        def slope(self: Any, metallic: Any) -> Any:
            return (1.0 - self.dielectric) / np.pi + metallic * (1.0 - self.schlick) * self.specular

        return [(Facets, "bsdf", both), (Facets, "slope_in_color", slope)]


@caught_by("test_metallic_mixes", "test_metallic_maps_lie_as_textures", whole=True)
class MetalOrNot(OnNumpy):
    """Metallic is rounded to 0 or 1."""

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "metallic", lambda metallic: metallic.round()))


@caught_by("test_gloss_shines_at_the_mirror_angle", whole=True)
class MoreGlossAtNormalIncidence(Patched):
    """F0 is 0.05."""

    def patches(self) -> list[Patch]:
        return [(bsdf, "DIELECTRIC_REFLECTANCE", 0.05)]


@caught_by(
    "test_gloss_shines_at_the_mirror_angle",
    "test_gloss_in_uniform_light_is_the_formulas",
    whole=True,
    reason="On black, and at a grazing angle.",
)
class GlossIsTinted(Patched):
    """The gloss of a dielectric is of its base colour, as a metal's is."""

    def patches(self) -> list[Patch]:
        right = Facets.reflectance

        def tinted(self: Any, color: Any, metallic: Any) -> Any:
            return right(self, color, metallic) * (metallic + (1.0 - metallic) * color)

        return [(Facets, "reflectance", tinted)]


@caught_by("test_metal_in_uniform_light_is_the_formulas", "test_light_and_viewer_may_be_exchanged", whole=True)
class ShadowingWithoutMasking(Patched):
    """Facets are shadowed from the light, and not masked from the viewer."""

    def patches(self) -> list[Patch]:
        def one_sided(self: Any) -> Any:
            smith = ggx.masking(self.incoming, self.alpha2) / np.maximum(self.outgoing, 1e-4)
            return (0.25 * ggx.distribution(self.half, self.alpha2) * smith)[:, None]

        return [(Facets, "specular", property(one_sided))]


@caught_by("test_metal_in_uniform_light_is_the_formulas", whole=True, late=True)
class CorrelatedSmith(Patched):
    """Masking and shadowing are correlated by height, as in glTF's sample code; the conventions take the product."""

    def patches(self) -> list[Patch]:
        def correlated(self: Any) -> Any:
            views = [np.sqrt(self.alpha2 + (1.0 - self.alpha2) * c**2) for c in (self.incoming, self.outgoing)]
            shares = 0.5 / np.maximum(self.outgoing * views[0] + self.incoming * views[1], 1e-9)
            return (ggx.distribution(self.half, self.alpha2) * shares)[:, None]

        return [(Facets, "specular", property(correlated))]


@caught_by(
    "test_smooth_is_bounded",
    "test_roughness_below_its_bound_has_no_gradient",
    reason="In pictures between texels, and in gradients.",
)
class BoundedBeforeLookup(OnNumpy):
    """Texels of roughness are bounded, and not what is looked up."""

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "roughness", lambda rough: rough.clamp_min(0.05)))


@caught_by("test_image_of_metal_in_total", late=True)
class DensityOffByAPercent(Patched):
    """The density of directions drawn by GGX is taken for 1 % larger than it is."""

    def patches(self) -> list[Patch]:
        right = ggx.pdf
        return [(ggx, "pdf", lambda *cosines: 1.01 * right(*cosines))]


@caught_by(
    "test_metal_in_uniform_light_is_the_formulas",
    "test_metal_is_tinted",
    "test_rims_are_not_black",
    whole=True,
    reason="Where facets are seen from aslant.",
)
class DensityOfAllFacets(Patched):
    """Facets are drawn that are seen, and their density is taken for that of all."""

    def patches(self) -> list[Patch]:
        def pdf(outgoing: Any, half: Any, alpha2: Any) -> Any:
            return 0.25 * ggx.distribution(half, alpha2) * np.ones_like(outgoing)

        return [(ggx, "pdf", pdf)]


@caught_by("test_the_gradient_of_metallic_in_total", late=True, reason="Too little for any texel alone.")
class MetallicGradientTooSteep(OnNumpy):
    """The gradient of metallic is 2 % too large."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradient_of(gradients, "metallic", lambda gradient: 1.02 * gradient)


@caught_by("test_the_gradient_of_roughness_in_total", late=True, reason="Too little for any texel alone.")
class RoughnessGradientSteeper(OnNumpy):
    """The gradient of roughness is 2 % too large."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradient_of(gradients, "roughness", lambda gradient: 1.02 * gradient)


@caught_by("test_metallic_gradients_of_whole_materials", whole=True)
class MetallicGradientOfGlossAlone(Patched):
    """The gradient of metallic has no diffuse term."""

    def patches(self) -> list[Patch]:
        def slope(self: Any, color: Any) -> Any:
            tinted = color + (1.0 - color) * self.schlick
            return (tinted - self.dielectric) * self.specular

        return [(Facets, "slope_in_metallic", slope)]


@caught_by("test_roughness_gradients_of_whole_materials", whole=True)
class GradientThroughTheDensity(Patched):
    """The gradient of roughness takes the density of drawn directions for a function of it, and the draw for none."""

    def patches(self) -> list[Patch]:
        right = renderer.shade_vjp

        def shade_vjp(bounce: Any, shading: Any, maps: Any, grad_reflected: Any) -> Any:
            outgoing, step = bounce.vertices.points.outgoing, 1e-4
            more, less = (replace(shading.bsdf, roughness=shading.bsdf.roughness + s) for s in (step, -step))
            extra = np.zeros(len(outgoing))
            for arrival, reflected, grad in zip(bounce.arrivals, shading.reflected, grad_reflected, strict=True):
                of_density = (more.pdf(outgoing, arrival.direction) - less.pdf(outgoing, arrival.direction)) / (
                    2 * step
                )
                # the light has been divided by the density: the sum of its weights is the inverse
                extra -= (grad * reflected).sum(axis=-1) * of_density * arrival.light.weight.sum(axis=-1)
            for name, taps, of_lookup in right(bounce, shading, maps, grad_reflected):
                lookup = bounce.vertices.lookups[name].points
                yield name, taps, of_lookup + extra[lookup, None] if name == "roughness" else of_lookup

        return [(renderer, "shade_vjp", shade_vjp)]


@caught_by("test_base_color_beneath_all_maps")
class ColorGradientWithoutTint(Patched):
    """The gradient of the base colour has no share of what metal reflects."""

    def patches(self) -> list[Patch]:
        def slope(self: Any, metallic: Any) -> Any:
            return (1.0 - metallic) * (1.0 - self.dielectric) / np.pi

        return [(Facets, "slope_in_color", slope)]
