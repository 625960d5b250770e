"""Layers: what is painted over the materials of a surface, as one texture. Torch, float32, linear."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import accumulate

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.types.material import CHANNELS

RGBA = 4
"""Channels of a layer before those of further maps."""

FURTHER_MAPS = tuple(name for name in CHANNELS if name != "base_color")
"""Maps that layers may have besides base_color."""


def layer_channels(maps: Iterable[str]) -> int:
    """Channels of a layer that paints these maps besides base_color."""
    return RGBA + sum(CHANNELS[name] for name in maps)


def channel_slices(maps: Iterable[str]) -> dict[str, slice]:
    """The channels at which a layer holds `base_color`, `alpha` and these further maps, which have that order."""
    sizes = {"base_color": CHANNELS["base_color"], "alpha": 1, **{name: CHANNELS[name] for name in maps}}
    ends = accumulate(sizes.values())
    return {name: slice(end - size, end) for (name, size), end in zip(sizes.items(), ends, strict=True)}


@dataclass(frozen=True, eq=False)
class Layer:
    """Base colour of straight alpha, and further maps under the same alpha.

        layer["roughness"]  # (rows, cols, 1)

    Attributes:
        values: base colour, alpha, and then the further maps. Any axes lead; of a texture, row 0 is at v = 0.
        maps: names of the further maps, in the order of `FURTHER_MAPS`.

    Raises:
        AssetError: the maps are unknown or in another order, or there are channels for others.
    """

    values: Float[Tensor, "*shape channels"]
    maps: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if self.maps != tuple(name for name in FURTHER_MAPS if name in self.maps):
            raise AssetError(f"a layer paints {self.maps}; wanted some of {FURTHER_MAPS}, each once and in this order.")
        found, wanted = self.values.shape[-1], layer_channels(self.maps)
        if found != wanted:
            names = ", ".join(("base_color", *self.maps))
            raise AssetError(f"a layer has {found} channels; wanted {wanted}, for {names} and alpha.")

    def __getitem__(self, name: str) -> Float[Tensor, "*shape values"]:
        """A map, or "alpha"; a view of `values`.

        Raises:
            KeyError: the layer does not paint that map.
        """
        return self.values[..., channel_slices(self.maps)[name]]

    @property
    def base_color(self) -> Float[Tensor, "*shape 3"]:
        return self["base_color"]

    @property
    def alpha(self) -> Float[Tensor, "*shape"]:
        return self["alpha"][..., 0]

    @property
    def rgba(self) -> Float[Tensor, "*shape 4"]:
        """Base colour and alpha."""
        return self.values[..., :RGBA]

    @property
    def further(self) -> Float[Tensor, "*shape values"]:
        """The further maps side by side."""
        return self.values[..., RGBA:]

    def to(self, device: torch.device | str) -> Layer:
        """The layer on a device."""
        return replace(self, values=self.values.to(device))
