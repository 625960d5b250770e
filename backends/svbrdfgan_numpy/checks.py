"""What the renderer refuses, at its border."""

from __future__ import annotations

from collections.abc import Set

from torch import Tensor

from svbrdfgan.errors import ConfigError, UnsupportedError
from svbrdfgan.types import Materials, Surface, View


def check_materials(surface: Surface, materials: Materials, read: Set[str]) -> None:
    """Refuse materials that do not fit the surface.

    Raises:
        ConfigError: not one material for each part.
        UnsupportedError: a map that is not among those `read`.
    """
    if len(materials) != len(surface.parts):
        raise ConfigError(
            f"numpy renderer: got {len(materials)} materials for a surface of {len(surface.parts)} parts; "
            "wanted one for each part, in the surface's order."
        )
    for part, material in zip(surface.parts, materials.parts, strict=True):
        if unread := sorted(set(material.maps) - read):
            raise UnsupportedError(
                f"numpy renderer: the material of part {part.name!r} has {', '.join(unread)}; read are only "
                f"{', '.join(sorted(read))}: drop the map or choose another renderer."
            )


def check_gradient(view: View, grad_image: Tensor, wrt: Set[str], differentiable: Set[str]) -> None:
    """Refuse a gradient that is not of the view's film, or is wanted for what has none.

    Raises:
        ConfigError: the shape is not (height, width, 3).
        UnsupportedError: `wrt` names something unknown.
    """
    if grad_image.shape != (view.height, view.width, 3):
        raise ConfigError(
            f"numpy renderer: grad_image has shape {tuple(grad_image.shape)}; wanted {(view.height, view.width, 3)}."
        )
    if unknown := sorted(wrt - differentiable):
        raise UnsupportedError(
            f"numpy renderer: there is no gradient for {', '.join(unknown)}; "
            f"wrt may name {', '.join(sorted(differentiable))}."
        )
