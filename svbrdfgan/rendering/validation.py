"""Checks of arguments, for renderers to call before they render. Messages name the renderer by its entry point.

With the checks in `Environment`, `Material` and `View` themselves, these are all that the conformance kit demands.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import Materials, View
from svbrdfgan.types.material import CHANNELS


def check_render(
    renderer: str,
    capabilities: RendererCapabilities,
    parts: Sequence[str],
    materials: Materials,
    *,
    spp: int,
    wrt: Set[str] = frozenset(),
) -> None:
    """Checks the arguments of `render`, `render_vjp` and `render_pullback`.

    Args:
        parts: the names of the surface's parts.

    Raises:
        ConfigError: `spp` is below 1, or the number of materials is not that of the parts.
        UnsupportedError: a map is not in `capabilities.maps`, or a name in `wrt` not in `capabilities.differentiable`.
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
                f"{renderer} renderer: the material of part {part!r} has {', '.join(unread)}, but the renderer reads "
                f"only {', '.join(sorted(capabilities.maps))}; drop the map or choose another renderer."
            )
    if unknown := sorted(wrt - capabilities.differentiable):
        raise UnsupportedError(
            f"{renderer} renderer: it has no gradient for {', '.join(unknown)}; "
            f"wrt may name {', '.join(sorted(capabilities.differentiable)) or 'nothing'}."
        )


def check_transport(renderer: str, capabilities: RendererCapabilities, *, spp: int) -> None:
    """Checks the arguments of `transport`. Call it outside a generator, whose body would run at the first sample only.

    Raises:
        ConfigError: `spp` is below 1.
        UnsupportedError: `capabilities.transport` is false.
    """
    if not capabilities.transport:
        raise UnsupportedError(
            f"{renderer} renderer: it has no transport where max_bounces is {capabilities.max_bounces}; "
            "`svbrdfgan backends` shows which renderers have it."
        )
    _check_samples(renderer, spp)


def check_store_light(
    renderer: str,
    capabilities: RendererCapabilities,
    parts: Sequence[str],
    learnable: Sequence[int],
    *,
    hits: int,
    spp: int,
) -> None:
    """Checks the arguments of `store_light`.

    Raises:
        ConfigError: `spp` or `hits` is below 1, or `learnable` names a part twice or one that the surface lacks.
        UnsupportedError: `capabilities.deferred` is false.
    """
    if not capabilities.deferred:
        raise UnsupportedError(
            f"{renderer} renderer: it stores no light; `svbrdfgan backends` shows which renderers do."
        )
    _check_samples(renderer, spp)
    if hits < 1:
        raise ConfigError(f"{renderer} renderer: hits is {hits}; wanted at least 1 for each pixel.")
    if len(set(learnable)) < len(learnable) or not set(learnable) <= set(range(len(parts))):
        raise ConfigError(
            f"{renderer} renderer: learnable is {list(learnable)}; wanted numbers of parts from 0 to "
            f"{len(parts) - 1}, each at most once."
        )


def check_shade(
    renderer: str,
    capabilities: RendererCapabilities,
    views: Sequence[tuple[tuple[int, int], int]],
    textures: Float[Tensor, "textures rows cols channels"],
    maps: Sequence[str],
    *,
    visit: int,
) -> None:
    """Checks the arguments of `shade`.

    Args:
        views: of each view, the film's (height, width) and the number of learnable parts.

    Raises:
        ConfigError: there is no view, films differ in size, `visit` is negative, `maps` lacks base_color, names a map
            twice, in another order, or metallic without roughness, or the textures do not fit the views or the maps.
        UnsupportedError: a map is not in `capabilities.maps`.
    """
    if not views:
        raise ConfigError(f"{renderer} renderer: shade got no stored light; wanted that of one view or more.")
    if len(films := sorted({film for film, _ in views})) > 1:
        sizes = ", ".join(f"{height} x {width}" for height, width in films)
        raise ConfigError(
            f"{renderer} renderer: shade got views of {sizes} pixels (height x width); wanted one size for all."
        )
    if visit < 0:
        raise ConfigError(f"{renderer} renderer: visit is {visit}; wanted 0 or more.")
    if unread := sorted(set(maps) - capabilities.maps):
        raise UnsupportedError(
            f"{renderer} renderer: maps names {', '.join(unread)}, but the renderer reads only "
            f"{', '.join(sorted(capabilities.maps))}."
        )
    if list(maps) != [name for name in CHANNELS if name in {"base_color", *maps}]:
        raise ConfigError(
            f"{renderer} renderer: maps is {', '.join(maps) or 'empty'}; wanted base_color, then each further map "
            f"once, in the order of {', '.join(CHANNELS)}."
        )
    if "metallic" in maps and "roughness" not in maps:
        raise ConfigError(f"{renderer} renderer: maps has metallic without roughness; wanted both or neither.")
    count, channels = sum(learnable for _, learnable in views), sum(CHANNELS[name] for name in maps)
    if textures.ndim != 4 or (textures.shape[0], textures.shape[3]) != (count, channels):
        raise ConfigError(
            f"{renderer} renderer: textures have shape {tuple(textures.shape)}; wanted ({count}, rows, cols, "
            f"{channels}): one for each learnable part of each view, with the channels of {', '.join(maps)}."
        )


def check_cotangent(renderer: str, view: View, grad_image: Tensor) -> None:
    """Checks that `grad_image` has the shape of the view's film.

    Raises:
        ConfigError: its shape is not (height, width, 3).
    """
    film = (view.height, view.width, 3)
    if grad_image.shape != film:
        raise ConfigError(f"{renderer} renderer: grad_image has shape {tuple(grad_image.shape)}; wanted {film}.")


def check_cotangents(renderer: str, shape: Sequence[int], grad_images: Tensor) -> None:
    """Checks that the gradient of shaded pictures has their shape.

    Raises:
        ConfigError: it has another.
    """
    if grad_images.shape != tuple(shape):
        raise ConfigError(
            f"{renderer} renderer: the pictures' gradient has shape {tuple(grad_images.shape)}; wanted {tuple(shape)}."
        )


def check_radiance(radiance: Float[Tensor, "rows cols 3"]) -> None:
    """Checks that the image is light. This reads every pixel, and on a GPU waits for the result.

    Raises:
        AssetError: a value is negative or not finite.
    """
    low, high = torch.aminmax(radiance.detach())
    if not ((low >= 0.0) & (high < torch.inf)):  # both are NaN if any value is
        raise AssetError("environment holds radiance that is negative or not finite; wanted light: clean the image.")


def check_device(renderer: str, prepared: torch.device, device: torch.device) -> None:
    """Checks that the surface was prepared on the renderer's device.

    Raises:
        ConfigError: it was prepared on another.
    """
    if prepared != device:
        raise ConfigError(
            f"{renderer} renderer: the surface was prepared on {prepared}; prepare it again for {device}."
        )


def _check_samples(renderer: str, spp: int) -> None:
    if spp < 1:
        raise ConfigError(f"{renderer} renderer: spp is {spp}; wanted at least 1 sample per pixel.")
