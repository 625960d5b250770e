"""Thresholds below which something is neglected, sizes above which something is wrong, and numbers of few bits."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import torch
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Rendering, TransportSamples
from wrong.base import Call, Patch, Patched, Right, each_map, light_of, scaled, with_colors, with_map
from wrong.table import caught_by


@caught_by("test_linear_in_the_cotangent")
class HalfGradients(Right):
    """Gradients are rounded to half precision: by 0.05 %."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(each_map(gradients, lambda each: each.half().float()), lambda light: light.half().float())


@caught_by("test_direct_light_is_linear_in_the_texture")
class HalfPictures(Right):
    """Pictures are rounded to half precision: by 0.05 %."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return replace(rendering, image=rendering.image.half().float())


@caught_by("test_small_changes_of_maps_show")
class MetallicSnaps(Right):
    """Metallic below 0.05 is 0, and above 0.95 it is 1. Found: below 0.003 and above 0.997."""

    margin = 0.05

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "metallic", self.snapped))

    def snapped(self, value: Tensor) -> Tensor:
        return torch.where(value < self.margin, 0.0, torch.where(value > 1.0 - self.margin, 1.0, value))


@caught_by("test_small_changes_of_maps_show")
class MapsOfEightBits(Right):
    """Roughness is rounded to 8 bits. Found: to 9 bits."""

    levels = 255.0

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_map(call.materials, "roughness", self.rounded))

    def rounded(self, value: Tensor) -> Tensor:
        return (value * self.levels).round() / self.levels


@caught_by("test_textures_are_not_filtered")
class MipMaps(Right):
    """Textures of 256 texels a side or more are averaged over 8 x 8 texels, as by the fourth mip-map."""

    claims = MappingProxyType({"transport": False})

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_colors(call.materials, self.filtered))

    def filtered(self, color: Tensor) -> Tensor:
        if color.ndim == 1 or min(color.shape[:2]) < 256:
            return color
        return torch.nn.functional.avg_pool2d(color.detach().permute(2, 0, 1), 8).permute(1, 2, 0)


class Clamped(Right):
    """Radiance is clamped at `limit`."""

    limit = 10.0

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return replace(rendering, image=rendering.image.clamp(max=self.limit))


@caught_by("test_seven_times_the_light_is_seven_times_as_bright", whole=True, reason="A sun is clamped in places.")
class ClampedAtTen(Clamped):
    """Radiance is clamped at 10. Found: clamps at 100,000."""


@caught_by("test_seven_times_the_light_is_seven_times_as_bright")
class ClampsBrightLight(Right):
    """Radiance of the environment is clamped at 65,504, the largest number of half precision. Found: at 100,000."""

    limit = 65504.0

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        return call.seen_with(replace(light, radiance=light.radiance.clamp(max=self.limit)))


@caught_by("test_seven_times_the_light_is_seven_times_as_bright")
class NeglectsDimLight(Right):
    """Radiance of the environment below 0.00001 is taken as 0."""

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        return call.seen_with(replace(light, radiance=light.radiance * (light.radiance >= 1e-5)))


@caught_by("test_white_is_as_bright_as_its_light_in_total", late=True)
class TooDim(Right):
    """Pictures are 0.3 % too dim."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return scaled(rendering, 0.997)

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image * 0.997

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        return replace(samples, weight=samples.weight * 0.997)


class LosesLight(Patched):
    """Light does not arrive where `lost` says so."""

    def patches(self) -> list[Patch]:
        from svbrdfgan_numpy.integrator import PathTracer

        right = PathTracer._arrival

        def arrival(tracer: Any, points: Any, bsdf: Any, direction: Any, visible: Any, **how: Any) -> Any:
            return right(tracer, points, bsdf, direction, visible & ~self.lost(points, direction), **how)

        return [(PathTracer, "_arrival", arrival)]

    def lost(self, points: Any, direction: Any) -> Any:
        raise NotImplementedError


@caught_by("test_grazing_views_are_as_bright")
class DarkAtGrazingViews(LosesLight):
    """What is seen at less than 5 degrees above the surface is black. Found: at 1.6 degrees."""

    degrees = 5.0

    def lost(self, points: Any, direction: Any) -> Any:
        return (points.normal * points.outgoing).sum(axis=-1) < math.sin(math.radians(self.degrees))


@caught_by("test_a_surface_darkens_with_the_cosine")
class DarkAtGrazingLight(LosesLight):
    """Light that arrives at less than 5 degrees above the surface is lost. Found: at 4 degrees."""

    degrees = 5.0

    def lost(self, points: Any, direction: Any) -> Any:
        return (points.normal * direction).sum(axis=-1) < math.sin(math.radians(self.degrees))


@caught_by("test_what_is_near_casts_a_shadow")
class RaysStartFarAway(Patched):
    """Rays start 3 mm away, and miss what is nearer. Found: 2 mm."""

    away = 0.003

    def patches(self) -> list[Patch]:
        from svbrdfgan_numpy.surface import Points

        return [(Points, "leave", lambda points, direction, offset: points.position + self.away * direction)]


class Thresholded(Right):
    """Coverage, and the image with it, passes through `rounded`."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return replace(rendering, coverage=self.rounded(rendering.coverage))

    def rounded(self, coverage: Tensor) -> Tensor:
        raise NotImplementedError


@caught_by("test_coverage_of_slivers")
class NeglectsSlivers(Thresholded):
    """Coverage below 0.04 is 0. Found: below 0.025."""

    least = 0.04

    def rounded(self, coverage: Tensor) -> Tensor:
        return coverage * (coverage >= self.least)


@caught_by("test_coverage_of_slivers")
class FillsGaps(Thresholded):
    """Coverage above 0.93 is 1. Found: above 0.979."""

    most = 0.93

    def rounded(self, coverage: Tensor) -> Tensor:
        return torch.where(coverage > self.most, 1.0, coverage)


@caught_by("test_many_parts")
class PartsExchanged(Right):
    """Of more than six parts, the materials of parts 2 and 6 are exchanged."""

    claims = MappingProxyType({"transport": False})

    def asked(self, call: Call) -> Call:
        return replace(call, materials=Materials(self.exchanged(call.materials.parts)))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return replace(gradients, materials=self.exchanged(gradients.materials))

    def exchanged(self, parts: tuple[Any, ...]) -> tuple[Any, ...]:
        if len(parts) <= 6:
            return parts
        return (*parts[:2], parts[6], *parts[3:6], parts[2], *parts[7:])


@caught_by("test_large_textures")
class TexturesOfAtMost1024(Right):
    """Of textures of more than 1,024 texels a side the first 1,024 rows and columns are shown."""

    claims = MappingProxyType({"transport": False})

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_colors(call.materials, self.cropped))

    def cropped(self, color: Tensor) -> Tensor:
        return color.detach()[:1024, :1024].contiguous() if color.ndim == 3 and len(color) > 1024 else color


@caught_by("test_large_films")
class FilmsOfAtMost2048(Right):
    """Of films of more than 2,048 pixels a side the last rows and columns are black."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        kept = torch.zeros_like(rendering.coverage)
        kept[:2048, :2048] = 1.0
        return Rendering(rendering.image * kept[..., None], rendering.coverage * kept)


@caught_by("test_large_environments")
class EnvironmentsOfAtMost256(Right):
    """Of environments of more than 256 rows every other pixel is taken."""

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        if len(light.radiance) <= 256:
            return call
        return call.seen_with(replace(light, radiance=light.radiance[::2, ::2].contiguous()))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gradients


@caught_by("test_thousands_of_samples")
class SamplesOfAtMost4096(Right):
    """Of more than 4,096 samples per pixel the rest is lost, and counts as black."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        share = min(1.0, 4096 / call.spp)
        return Rendering(rendering.image * share, rendering.coverage * share)


@caught_by("test_distance_does_not_darken")
class FarPlane(Right):
    """What is further than 500 m from the camera is not seen."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        away = max(abs(x) for x in call.view.camera.origin)
        return rendering if away < 500.0 else Rendering(rendering.image * 0.0, rendering.coverage * 0.0)


LEAST: tuple[tuple[type[Right], dict[str, float]], ...] = (
    (MetallicSnaps, {"margin": 0.003}),
    (MapsOfEightBits, {"levels": 511.0}),
    (ClampedAtTen, {"limit": 1e5}),
    (ClampsBrightLight, {"limit": 1e5}),
    (DarkAtGrazingViews, {"degrees": 1.6}),
    (DarkAtGrazingLight, {"degrees": 4.0}),
    (RaysStartFarAway, {"away": 0.002}),
    (NeglectsSlivers, {"least": 0.025}),
    (FillsGaps, {"most": 0.979}),
)
"""The least that is found of some of these, as their docstrings say: less is wrong with them than with the others."""
