"""Pictures, textures, cameras and environments that lie another way."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Rendering, Surface, TransportSamples
from wrong.base import Call, Right, light_of
from wrong.table import caught_by


@caught_by("test_texture_row_0_is_at_the_bottom", whole=True)
class TextureUpsideDown(Right):
    """Texture row 0 on top, as in picture files."""

    def surface(self, surface: Surface) -> Surface:
        return replace(surface, uv=np.stack([surface.uv[:, 0], 1.0 - surface.uv[:, 1]], axis=-1))


class Flipped(Right):
    """The film turned over along an axis."""

    axis: ClassVar[int]

    def picture(self, rendering: Rendering, call: Call) -> Rendering:
        return Rendering(rendering.image.flip(self.axis), rendering.coverage.flip(self.axis))

    def cotangent(self, grad_image: Tensor, call: Call) -> Tensor:
        return grad_image.flip(self.axis)

    def samples(self, samples: TransportSamples, call: Call) -> TransportSamples:
        film = torch.arange(call.view.height * call.view.width, device=samples.pixel.device)
        turned = film.reshape(call.view.height, call.view.width).flip(self.axis).reshape(-1)
        return replace(samples, pixel=turned[samples.pixel])


@caught_by("test_right_is_right", whole=True)
class PictureMirrored(Flipped):
    """Left is right."""

    axis = 1


@caught_by("test_row_0_of_the_picture_is_its_top", whole=True)
class PictureUpsideDown(Flipped):
    """Row 0 at the bottom."""

    axis = 0


class EnvironmentFlipped(Right):
    """The environment turned over along an axis."""

    axis: ClassVar[int]

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        return call.seen_with(replace(light, radiance=light.radiance.flip(self.axis)))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return light_of(gradients, lambda light: light.flip(self.axis))


@caught_by("test_columns_of_the_environment_go_round", whole=True)
class EnvironmentMirrored(EnvironmentFlipped):
    """The azimuth has the wrong sign."""

    axis = 1


@caught_by(
    "test_row_0_of_the_environment_is_the_zenith",
    "test_unlit_texels_have_no_gradient",
    whole=True,
    reason="What should be unlit is lit from above.",
)
class EnvironmentUpsideDown(EnvironmentFlipped):
    """Row 0 at the nadir."""

    axis = 0


class Turned(Right):
    """The environment's rotation, misread."""

    factor: ClassVar[float]

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        return call.seen_with(replace(light, rotation=light.rotation * self.factor))


@caught_by("test_rotation_turns_the_light_counter_clockwise", whole=True)
class RotationIgnored(Turned):
    """The environment stands still."""

    factor = 0.0


@caught_by("test_rotation_turns_the_light_counter_clockwise", whole=True)
class RotationClockwise(Turned):
    """The environment turns the wrong way."""

    factor = -1.0


class Resampled(Right):
    """The environment with five columns for each of its own; the same light, but for what `across` does at the seam."""

    def across(self, cols: int) -> Float[Tensor, "fine cols"]:
        position = (torch.arange(5 * cols, dtype=torch.float32) + 0.5) / 5.0 - 0.5
        left, rest = position.floor().long(), position - position.floor()
        matrix = torch.zeros(5 * cols, cols + 2, dtype=torch.float32)
        rows = torch.arange(5 * cols)
        matrix[rows, left + 1] = 1.0 - rest
        matrix[rows, left + 2] += rest
        return self.seam(matrix)

    def seam(self, matrix: Float[Tensor, "fine padded"]) -> Float[Tensor, "fine cols"]:
        """The columns before the first and behind the last one, added to the others."""
        inner = matrix[:, 1:-1].clone()
        inner[:, 0] += matrix[:, 0]
        inner[:, -1] += matrix[:, -1]
        return inner

    def asked(self, call: Call) -> Call:
        light = call.view.environment
        fine = torch.einsum("fc,rck->rfk", self.across(light.radiance.shape[1]), light.radiance.detach().cpu().float())
        return call.seen_with(replace(light, radiance=fine))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        matrix = self.across(call.view.environment.radiance.shape[1])
        return light_of(gradients, lambda light: torch.einsum("fc,rfk->rck", matrix, light.cpu()))


@caught_by("test_the_environment_has_no_seam", whole=True)
class EnvironmentEndsAtTheSeam(Resampled):
    """Columns are clamped at the seam, as textures are."""


@caught_by(
    "test_the_field_of_view_is_vertical",
    "test_pixels_are_in_their_rows",
    reason="A square has another size on a wide film.",
)
class HorizontalFieldOfView(Right):
    """`vertical_fov` over the width."""

    def asked(self, call: Call) -> Call:
        camera, view = call.view.camera, call.view
        fov = 2.0 * math.atan(math.tan(camera.vertical_fov / 2.0) * view.height / view.width)
        return replace(call, view=replace(view, camera=replace(camera, vertical_fov=fov)))


@caught_by("test_up_is_what_the_camera_says")
class UpIsAlwaysY(Right):
    """The camera's `up` is not looked at, where it can be done without."""

    def asked(self, call: Call) -> Call:
        camera = call.view.camera
        sight = np.subtract(camera.target, camera.origin)
        if abs(sight[1]) > 0.99 * np.linalg.norm(sight):
            return call
        return replace(call, view=replace(call.view, camera=replace(camera, up=(0.0, 1.0, 0.0))))
