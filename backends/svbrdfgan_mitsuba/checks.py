"""What the renderer refuses, at its border."""

from __future__ import annotations

from collections.abc import Set

from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Environment, Materials, View
from svbrdfgan_mitsuba.scene import PreparedSurface


def check_materials(parts: tuple[str, ...], materials: Materials, capabilities: RendererCapabilities) -> None:
    """Refuse materials that do not fit the surface.

    Raises:
        ConfigError: not one material for each part.
        UnsupportedError: a map that is not read.
    """
    if len(materials) != len(parts):
        raise ConfigError(
            f"mitsuba renderer: got {len(materials)} materials for a surface of {len(parts)} parts; "
            "wanted one for each part, in the surface's order."
        )
    known = sorted(capabilities.maps)
    for part, material in zip(parts, materials.parts, strict=True):
        if unread := sorted(material.maps.keys() - capabilities.maps):
            raise UnsupportedError(
                f"mitsuba renderer: the material of part {part!r} has {', '.join(unread)}; "
                f"only {' and '.join(known)} are read: drop the map or choose another renderer."
            )


def check_gradient(view: View, grad_image: Tensor, wrt: Set[str], capabilities: RendererCapabilities) -> None:
    """Refuse a gradient that is not of the view's film, or is wanted for what has none.

    Raises:
        ConfigError: the shape is not (height, width, 3).
        UnsupportedError: `wrt` names something unknown.
    """
    film = (view.height, view.width, 3)
    if grad_image.shape != film:
        raise ConfigError(f"mitsuba renderer: grad_image has shape {tuple(grad_image.shape)}; wanted {film}.")
    if unknown := sorted(wrt - capabilities.differentiable):
        raise UnsupportedError(
            f"mitsuba renderer: there is no gradient for {', '.join(unknown)}; "
            f"wrt may name {', '.join(sorted(capabilities.differentiable))}."
        )


def check_environment(environment: Environment) -> None:
    """Refuse what is no light.

    Raises:
        AssetError: radiance that is negative or not finite.
    """
    radiance = environment.radiance
    if not (radiance.isfinite() & (radiance >= 0.0)).all():
        raise AssetError("environment holds radiance that is negative or not finite; wanted light: clean the image.")


def check_call(prepared: PreparedSurface, device: object, spp: int) -> None:
    """Refuse a surface of another device, and no samples.

    Raises:
        ConfigError: either.
    """
    if spp < 1:
        raise ConfigError(f"mitsuba renderer: spp is {spp}; wanted at least 1 sample per pixel.")
    if prepared.device != device:
        raise ConfigError(
            f"mitsuba renderer: the surface was prepared on {prepared.device}; prepare it again for {device}."
        )
