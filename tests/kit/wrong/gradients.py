"""Gradients that are not those of the picture."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from svbrdfgan.types import Gradients
from wrong.base import Call, Right, each_map, light_of, with_colors
from wrong.filtering import gathered, magnified
from wrong.table import SLOPES, caught_by


@caught_by(*SLOPES, "test_transport_transposed_is_the_gradient", whole=True, reason="By differences, and by transport.")
class MapGradientTooSteep(Right):
    """The gradients of maps are 3 % too large."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return each_map(gradients, lambda gradient: gradient * 1.03)


@caught_by(
    "test_environment_sums_to_the_picture",
    "test_environment_moves_the_picture",
    whole=True,
    reason="A sum at one seed; rows on average.",
)
class LightGradientTooSteep(Right):
    """The gradient of the environment is 3 % too large."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(gradients, lambda gradient: gradient * 1.03)


@caught_by(*SLOPES, "test_transport_transposed_is_the_gradient", whole=True, reason="By differences, and by transport.")
class GradientToTheNearestTexel(Right):
    """The gradient of a texture is not interpolated, though pictures are."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        c = replace(call, materials=with_colors(call.materials, magnified))
        return replace(gradients, materials=gathered(self.vjp(c), call.materials).materials)


@caught_by(
    "test_base_color_of_textures_that_repeat",
    "test_transport_transposed_is_the_gradient",
    reason="By differences, and by transport.",
)
class GradientNeverRepeats(Right):
    """The gradient of a texture is clamped where the picture repeats it."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        clamped = self.right.prepare(replace(call.surface, repeat=(False, False)))
        return replace(gradients, materials=self.vjp(replace(call, prepared=clamped)).materials)


@caught_by(
    *SLOPES,
    "test_transport_transposed_is_the_gradient",
    "test_environment_sums_to_the_picture",
    "test_environment_moves_the_picture",
    whole=True,
    reason="Of textures and of light, by every test.",
)
class GradientOfTheMirroredPicture(Right):
    """Gradients take the picture's columns from right to left."""

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image.flip(1)


@caught_by(
    "test_environment_sums_to_the_picture",
    "test_environment_moves_the_picture",
    whole=True,
    reason="Part of the sum, and of each row, is missing.",
)
class LightGradientWithoutItsSides(Right):
    """The environment's first and last columns get no gradient."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        def cut(light: Tensor) -> Tensor:
            light = light.clone()
            light[:, [0, -1]] = 0.0
            return light

        return light_of(gradients, cut)


@caught_by(
    "test_environment_sums_to_the_picture",
    "test_environment_moves_the_picture",
    whole=True,
    reason="Each row of light is multiplied by the gradient of another.",
)
class LightGradientOffByARow(Right):
    """The environment's gradient lies one row too low."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(gradients, lambda light: light.roll(1, dims=0))


@caught_by(
    "test_base_color_of_every_texel_of_every_part",
    "test_transport_transposed_is_the_gradient",
    whole=True,
    reason="By differences, and by transport.",
)
class GradientOfAnotherPart(Right):
    """Gradients of parts whose maps are shaped alike are in another order."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        shapes = [{name: value.shape for name, value in part.items()} for part in gradients.materials]
        alike = [[other for other, shape in enumerate(shapes) if shape == own] for own in shapes]
        swapped = [group[-1 - group.index(part)] for part, group in enumerate(alike)]
        return replace(gradients, materials=tuple(gradients.materials[part] for part in swapped))


@caught_by("test_unseen_texels_have_no_gradient")
class GradientLeaksToTheUnseen(Right):
    """Texels that are not seen get a tiny gradient, beside others that are."""

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return each_map(gradients, lambda gradient: torch.where((gradient == 0.0) & gradient.any(), 1e-12, gradient))


@caught_by("test_linear_in_the_cotangent")
class ClipsGradients(Right):
    """Large gradients of pixels are clipped."""

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image.clamp(-4.0, 4.0)
