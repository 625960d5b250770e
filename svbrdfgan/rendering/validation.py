"""Checks of a renderer's arguments, which `CheckedRenderer` makes before each call. Messages name the renderer.

`Environment`, `Material` and `View` check the rest themselves.
"""

from __future__ import annotations

from collections.abc import Sequence, Set

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError, ConfigError, UnsupportedError
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.types import CHANNELS, Materials

_POWERS = {"transport": "transport", "pullback": "pullback", "deferred": "stored light"}
"""Each optional power of `RendererCapabilities`, in words."""


def check_materials(
    renderer: str, capabilities: RendererCapabilities, parts: Sequence[str], materials: Materials
) -> None:
    """Checks the materials of a surface whose parts have these names.

    Raises:
        ConfigError: the number of materials is not that of the parts.
        UnsupportedError: a map is not in `capabilities.maps`.
    """
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


def check_differentiable(renderer: str, capabilities: RendererCapabilities, wrt: Set[str]) -> None:
    """Checks that there are gradients for all of these inputs.

    Raises:
        UnsupportedError: a name is not in `capabilities.differentiable`.
    """
    if unknown := sorted(wrt - capabilities.differentiable):
        raise UnsupportedError(
            f"{renderer} renderer: it has no gradient for {', '.join(unknown)}, only for "
            f"{', '.join(sorted(capabilities.differentiable)) or 'nothing'}; detach the input or choose another "
            "renderer."
        )


def check_declared(renderer: str, capabilities: RendererCapabilities, power: str) -> None:
    """Checks that the capabilities declare an optional power: "transport", "pullback" or "deferred".

    Raises:
        UnsupportedError: the power is not declared.
    """
    if not getattr(capabilities, power):
        raise UnsupportedError(
            f"{renderer} renderer: it has no {_POWERS[power]} (max_bounces is {capabilities.max_bounces}); "
            "`svbrdfgan backends` shows which renderers have it."
        )


def check_stored(renderer: str, parts: Sequence[str], learnable: Sequence[int], hits: int) -> None:
    """Checks what `store_light` is to keep.

    Raises:
        ConfigError: `hits` is below 1, or `learnable` names a part twice or one that the surface lacks.
    """
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


def check_cotangent(renderer: str, shape: Sequence[int], cotangent: Tensor) -> None:
    """Checks that the gradient of pictures has their shape.

    Raises:
        ConfigError: the gradient has another shape.
    """
    if cotangent.shape != tuple(shape):
        raise ConfigError(
            f"{renderer} renderer: the picture's gradient has shape {tuple(cotangent.shape)}; wanted {tuple(shape)}."
        )


def check_radiance(radiance: Float[Tensor, "rows cols 3"]) -> None:
    """Checks that the image is light. This reads every pixel, and on a GPU waits for the result.

    Raises:
        AssetError: a value is negative or not finite.
    """
    low, high = torch.aminmax(radiance.detach())
    if not ((low >= 0.0) & (high < torch.inf)):  # both are NaN if any value is
        raise AssetError("environment holds radiance that is negative or not finite; wanted light: clean the image.")


def check_samples(renderer: str, spp: int) -> None:
    """Checks the number of camera samples per pixel.

    Raises:
        ConfigError: `spp` is below 1.
    """
    if spp < 1:
        raise ConfigError(f"{renderer} renderer: spp is {spp}; wanted at least 1 sample per pixel.")
