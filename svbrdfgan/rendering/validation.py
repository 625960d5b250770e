"""What every renderer refuses, for renderers to call before they begin. Messages name the renderer by its entry point.

With `Environment`, `Material` and `View`, which check themselves, that is all that the conformance kit asks for.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Materials, View


def check_render(
    renderer: str,
    capabilities: RendererCapabilities,
    parts: Sequence[str],
    materials: Materials,
    *,
    spp: int,
    wrt: Set[str] = frozenset(),
) -> None:
    """Refuses what `render`, `render_vjp` and `render_pullback` cannot be asked for.

    Args:
        parts: the names of the surface's parts.

    Raises:
        ConfigError: `spp` is below 1, or there is not one material for each part.
        UnsupportedError: a map is not in `capabilities.maps`, or `wrt` not in `capabilities.differentiable`.
    """
    _check_samples(renderer, spp)
    if len(materials) != len(parts):
        raise ConfigError(
            f"{renderer} renderer: got {len(materials)} materials for a surface of {len(parts)} parts; "
            "wanted one for each part, in the surface's order."
        )
    for part, material in zip(parts, materials.parts, strict=True):
        if unread := sorted(material.maps.keys() - capabilities.maps):
            raise UnsupportedError(
                f"{renderer} renderer: the material of part {part!r} has {', '.join(unread)}; read are only "
                f"{', '.join(sorted(capabilities.maps))}: drop the map or choose another renderer."
            )
    if unknown := sorted(wrt - capabilities.differentiable):
        raise UnsupportedError(
            f"{renderer} renderer: there is no gradient for {', '.join(unknown)}; "
            f"wrt may name {', '.join(sorted(capabilities.differentiable)) or 'nothing'}."
        )


def check_transport(renderer: str, capabilities: RendererCapabilities, *, spp: int) -> None:
    """Refuses what `transport` cannot be asked for. Call it before the first sample is: not within a generator.

    Raises:
        ConfigError: `spp` is below 1.
        UnsupportedError: `capabilities.transport` is not declared.
    """
    if not capabilities.transport:
        raise UnsupportedError(
            f"{renderer} renderer: it has no transport where max_bounces is {capabilities.max_bounces}; "
            "`svbrdfgan backends` shows which renderers have it."
        )
    _check_samples(renderer, spp)


def check_cotangent(renderer: str, view: View, grad_image: Tensor) -> None:
    """Refuses the gradient of another film.

    Raises:
        ConfigError: `grad_image` is not (height, width, 3).
    """
    film = (view.height, view.width, 3)
    if grad_image.shape != film:
        raise ConfigError(f"{renderer} renderer: grad_image has shape {tuple(grad_image.shape)}; wanted {film}.")


def check_radiance(radiance: Float[Tensor, "rows cols 3"]) -> None:
    """Refuses what is no light. It reads all of the image, and on a GPU waits for it.

    Raises:
        AssetError: radiance is negative or not finite.
    """
    low, high = torch.aminmax(radiance.detach())
    if not ((low >= 0.0) & (high < torch.inf)):  # either is NaN if any value is
        raise AssetError("environment holds radiance that is negative or not finite; wanted light: clean the image.")


def check_device(renderer: str, prepared: torch.device, device: torch.device) -> None:
    """Refuses a surface that was prepared on another device.

    Raises:
        ConfigError: it was.
    """
    if prepared != device:
        raise ConfigError(
            f"{renderer} renderer: the surface was prepared on {prepared}; prepare it again for {device}."
        )


def _check_samples(renderer: str, spp: int) -> None:
    if spp < 1:
        raise ConfigError(f"{renderer} renderer: spp is {spp}; wanted at least 1 sample per pixel.")
