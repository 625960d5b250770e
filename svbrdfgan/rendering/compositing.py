"""Alpha compositing: a layer over a base material, an image over a background."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.types.material import CHANNELS

RGBA = 4
"""Channels of a layer before those of further maps."""


def layer_channels(maps: Iterable[str]) -> int:
    """Channels of a layer that paints these maps beside base_color: RGBA, then theirs in the order of `CHANNELS`."""
    return RGBA + sum(CHANNELS[name] for name in maps)


def layer_maps(channels: int) -> tuple[str, ...]:
    """The inverse of `layer_channels`, which is unique since metallic needs roughness.

    Raises:
        AssetError: no layer has that number of channels.
    """
    gloss: tuple[tuple[str, ...], ...] = ((), ("roughness",), ("roughness", "metallic"))
    for maps in (*gloss, *((*names, "normal") for names in gloss)):
        if layer_channels(maps) == channels:
            return maps
    raise AssetError(f"no layer has {channels} channels.")


BARE: Mapping[str, float] = MappingProxyType({"roughness": 0.9, "metallic": 0.0, "normal": 0.0})
"""What lies under a layer where nobody says anything: matt paint."""


def bare_maps(maps: Mapping[str, float]) -> dict[str, Float[Tensor, " channels"]]:
    """Maps under a layer, from the numbers that scenes declare for them. That of `normal` stands for the flat one."""
    flat = torch.tensor([0.0, 0.0, 1.0])
    return {name: flat if name == "normal" else torch.full((CHANNELS[name],), v) for name, v in maps.items()}


def composite(base: Float[Tensor, "*shape values"], layer: Float[Tensor, "*shape channels"]) -> Float[Tensor, ...]:
    """`base` under a layer of straight alpha (thesis 3.1), of the broadcast shape.

    A base of three values is reflectance alone; a longer one has a value for each channel of the layer but alpha.
    """
    values, alpha = layer[..., :3], layer[..., 3:RGBA]
    if base.shape[-1] > 3:
        values = torch.cat([values, layer[..., RGBA:]], dim=-1)
    return _blend(base, values, alpha)


def composite_maps(
    base: Mapping[str, Tensor], layer: Float[Tensor, "rows cols channels"], painted: Collection[str] | None = None
) -> dict[str, Tensor]:
    """The maps of a material under a layer.

    Args:
        painted: the maps that the layer paints beside base_color; by default all of the material's. Others stay bare.

    Raises:
        AssetError: the layer does not have the channels of these maps, or the material lacks one of them.
    """
    if painted is not None and (lacking := [name for name in painted if name not in base]):
        raise AssetError(f"a layer paints {', '.join(lacking)}, which the material under it does not have.")
    names = [name for name in CHANNELS if name in (base if painted is None else {"base_color", *painted})]
    wanted = layer_channels(names[1:])
    if layer.shape[-1] != wanted:
        raise AssetError(f"a layer has {layer.shape[-1]} channels; wanted {wanted}, for {', '.join(names)} and alpha.")
    color, alpha, *further = layer.split([3, 1, *(CHANNELS[name] for name in names[1:])], dim=-1)
    laid = {name: _blend(base[name], values, alpha) for name, values in zip(names, (color, *further), strict=True)}
    return {name: laid.get(name, values) for name, values in base.items()}


def over(
    image: Float[Tensor, "*shape 3"], coverage: Float[Tensor, "*shape"], background: Float[Tensor, "*#shape 3"]
) -> Float[Tensor, "*shape 3"]:
    """A premultiplied image of a surface over a background."""
    return image + (1.0 - coverage).unsqueeze(-1) * background


def _blend(base: Tensor, values: Tensor, alpha: Tensor) -> Tensor:
    return base + alpha * (values - base)
