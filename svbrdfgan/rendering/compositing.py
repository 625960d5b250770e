"""Alpha compositing: a layer over a base material, an image over a background."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.types import CHANNELS, Layer

BARE: Mapping[str, float] = MappingProxyType({"roughness": 0.9, "metallic": 0.0, "normal": 0.0})
"""What lies under a layer where nobody says anything: matt paint."""


def bare_maps(maps: Mapping[str, float]) -> dict[str, Float[Tensor, " channels"]]:
    """Maps under a layer, from the numbers that scenes declare for them. That of `normal` stands for the flat one."""
    flat = torch.tensor([0.0, 0.0, 1.0])
    return {name: flat if name == "normal" else torch.full((CHANNELS[name],), v) for name, v in maps.items()}


def composite(base: Float[Tensor, "*shape 3"], layer: Layer) -> Float[Tensor, "*shape 3"]:
    """Reflectance under a layer of straight alpha (thesis 3.1), of the broadcast shape."""
    return _blend(base, layer.base_color, layer["alpha"])


def composite_values(base: Float[Tensor, "*shape values"], layer: Layer) -> Float[Tensor, "*shape values"]:
    """Reflectance, and then the further maps that the layer paints, side by side under it; of the broadcast shape."""
    return _blend(base, torch.cat([layer.base_color, layer.further], dim=-1), layer["alpha"])


def composite_maps(base: Mapping[str, Tensor], layer: Layer) -> dict[str, Tensor]:
    """The maps of a material under a layer. Those that the layer does not paint stay bare.

    Raises:
        AssetError: the material lacks one of the layer's maps.
    """
    if lacking := [name for name in layer.maps if name not in base]:
        raise AssetError(f"a layer paints {', '.join(lacking)}, which the material under it does not have.")
    alpha, painted = layer["alpha"], ("base_color", *layer.maps)
    laid = {name: _blend(base[name], layer[name], alpha) for name in painted}
    return {name: laid.get(name, values) for name, values in base.items()}


def over(
    image: Float[Tensor, "*shape 3"], coverage: Float[Tensor, "*shape"], background: Float[Tensor, "*#shape 3"]
) -> Float[Tensor, "*shape 3"]:
    """A premultiplied image of a surface over a background."""
    return image + (1.0 - coverage).unsqueeze(-1) * background


def _blend(base: Tensor, values: Tensor, alpha: Tensor) -> Tensor:
    return base + alpha * (values - base)
