"""Textures that repeat or not, against what the surface says, and that are not interpolated."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Surface
from wrong.base import Call, Right, with_colors
from wrong.table import caught_by


@caught_by("test_textures_are_clamped_at_the_border", whole=True)
class RepeatsUnasked(Right):
    """Textures repeat where the surface does not say so."""

    claims = MappingProxyType({"transport": False})

    def surface(self, surface: Surface) -> Surface:
        return surface if any(surface.repeat) else replace(surface, repeat=(True, True))


@caught_by("test_textures_repeat_where_the_surface_says")
class NeverRepeats(Right):
    """Textures are always clamped."""

    claims = MappingProxyType({"transport": False})

    def surface(self, surface: Surface) -> Surface:
        return replace(surface, repeat=(False, False))


def magnified(texture: Tensor) -> Tensor:
    """A texture of 16 x 16 texels for each: bilinear there is almost nearest here. Large ones and constants as is."""
    if texture.ndim == 1 or texture.numel() > 1000:
        return texture
    return texture.detach().repeat_interleave(16, dim=0).repeat_interleave(16, dim=1)


def gathered(gradients: Gradients, materials: Materials) -> Gradients:
    """The transpose of `magnified`."""
    parts = []
    for part, material in zip(gradients.materials, materials.parts, strict=True):
        found = dict(part)
        if "base_color" in part and part["base_color"].shape != material.base_color.shape:
            rows, cols, channels = material.base_color.shape
            found["base_color"] = part["base_color"].reshape(rows, 16, cols, 16, channels).sum(dim=(1, 3))
        parts.append(found)
    return replace(gradients, materials=tuple(parts))


@caught_by(
    "test_textures_are_looked_up_bilinearly",
    "test_textures_repeat_where_the_surface_says",
    whole=True,
    reason="Near borders a texture that repeats is a mixture.",
)
class NearestTexel(Right):
    """Textures are not interpolated."""

    claims = MappingProxyType({"transport": False})

    def asked(self, call: Call) -> Call:
        return replace(call, materials=with_colors(call.materials, magnified))

    def gradient(self, gradients: Gradients, call: Call) -> Gradients:
        return gathered(gradients, call.materials)
