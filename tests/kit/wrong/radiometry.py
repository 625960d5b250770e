"""Pictures that are too bright, too dark, of other channels, or covered otherwise."""

from __future__ import annotations

import math
from dataclasses import replace
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Environment, Gradients, Material, Rendering, TransportSamples
from wrong.base import Call, Right, light_of, scaled, with_colors
from wrong.table import caught_by


@caught_by("test_white_in_uniform_light_is_as_bright_as_the_light", whole=True)
class ByPiTooBright(Right):
    """Radiance is base colour times irradiance."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return scaled(rendering, math.pi)

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image * math.pi

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        return replace(samples, weight=samples.weight * math.pi)


@caught_by(
    "test_direct_light_is_linear_in_the_texture",
    "test_texture_row_0_is_at_the_bottom",
    "test_each_part_has_its_own_material",
    whole=True,
    reason="Those that tell texels and parts by their grey find other greys.",
)
class DecodesTextures(Right):
    """Textures are decoded as if they were sRGB."""

    claims = MappingProxyType({"transport": False})

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_colors(call.materials, lambda color: color.detach() ** 2.2))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        def slope(name: str, material: Material) -> Tensor:
            return 2.2 * material.base_color.detach() ** 1.2 if name == "base_color" else torch.ones(1)

        parts = [
            {name: value * slope(name, material).to(value) for name, value in part.items()}
            for part, material in zip(gradients.materials, call.materials.parts, strict=True)
        ]
        return replace(gradients, materials=tuple(parts))


@caught_by(
    "test_seven_times_the_light_is_seven_times_as_bright",
    "test_a_surface_darkens_with_the_cosine",
    reason="A sun is dimmed, beside light that is not.",
)
class ExposesItself(Right):
    """Bright light is dimmed to an exposure that it likes."""

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        return call.seen_with(replace(light, radiance=light.radiance * self.exposure(light)))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(gradients, lambda light: light * self.exposure(call.view.environment))

    def exposure(self, light: Environment) -> float:
        return min(1.0, 3.0 / max(float(light.radiance.detach().mean()), 1e-9))


@caught_by(
    "test_no_light_is_black",
    "test_finite_in_the_dark_and_on_black",
    reason="There is no dark, in pictures and in gradients.",
)
class LightIsNeverBlack(Right):
    """Where there is no light a default is taken."""

    def asked(self, call: Call) -> Call:
        radiance = call.view.environment.radiance
        return call if radiance.any() else call.seen_with(Environment(torch.full_like(radiance, 0.1)))


@caught_by("test_channels_do_not_mix", whole=True)
class GreyLight(Right):
    """Of the light only its luminance counts."""

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        grey = light.radiance.mean(dim=-1, keepdim=True).expand_as(light.radiance)
        return call.seen_with(replace(light, radiance=grey.contiguous()))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(gradients, lambda light: light.mean(dim=-1, keepdim=True).expand_as(light).contiguous())


@caught_by("test_pictures_are_multiplied_by_coverage")
class NotPremultiplied(Right):
    """The image is the radiance of what is seen, however little of the pixel that covers."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return replace(rendering, image=rendering.image / self.covered(rendering))

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        if grad_image.shape[:2] != (call.view.height, call.view.width):
            return grad_image  # the right one refuses it
        return grad_image / self.covered(
            self.right.render(call.prepared, call.materials, call.view, spp=call.spp, seed=call.seed)
        )

    def covered(self, rendering: Rendering) -> Float[Tensor, "height width 1"]:
        """The coverage where it is not zero."""
        return torch.where(rendering.coverage > 0.0, rendering.coverage, 1.0)[..., None]


@caught_by(
    "test_values_are_in_range",
    "test_a_surface_out_of_sight_is_nothing",
    "test_pictures_are_multiplied_by_coverage",
    "test_pixels_are_in_their_rows",
    "test_right_is_right",
    "test_row_0_of_the_picture_is_its_top",
    "test_the_field_of_view_is_vertical",
    reason="It shows where nothing should be, and hides what is small.",
)
class BackgroundInThePicture(Right):
    """The environment is left in the picture."""

    claims = MappingProxyType({"transport": False})

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        background = call.view.environment.radiance.detach().float().mean(dim=(0, 1)).to(rendering.image.device)
        return replace(rendering, image=rendering.image + (1.0 - rendering.coverage[..., None]) * background)


@caught_by(
    "test_coverage_is_the_share_of_the_pixel",
    "test_transport_times_texture_is_the_picture",
    "test_transport_has_a_record_for_each_sample_that_met_the_surface",
    reason="Transport has the true one.",
)
class CoverageIsAllOrNothing(Right):
    """A pixel that shows anything of the surface counts as covered."""

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return replace(rendering, coverage=rendering.coverage.ceil())
