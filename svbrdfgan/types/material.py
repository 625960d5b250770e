"""Materials of surfaces: named maps. Torch, float32, linear."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.errors import AssetError

CHANNELS: Mapping[str, int] = MappingProxyType({"base_color": 3, "roughness": 1, "metallic": 1, "normal": 3})
"""The channels of each map that a material may have (`docs/conventions.md` defines the maps)."""

DIELECTRIC_REFLECTANCE = 0.04
"""Fresnel reflectance at normal incidence, F0, of a material with `roughness`."""

LEAST_ROUGHNESS = 0.05
"""Lower roughness is rendered as this: a perfect mirror has no density to sample."""


@dataclass(frozen=True, eq=False)
class Material:
    """Named maps, each a constant (channels,) or a texture (rows, cols, channels) with row 0 at v = 0.

    A material with `base_color` alone is Lambertian. With `roughness` it is glTF's metallic-roughness material, whose
    `metallic` is 0 unless given. `normal` tilts the shading normal of either; without it the surface is smooth.

    Raises:
        AssetError: a map of an unknown name or shape, no `base_color`, or `metallic` without `roughness`.
    """

    maps: Mapping[str, Float[Tensor, "*shape"]]

    def __post_init__(self) -> None:
        for name, value in self.maps.items():
            if name not in CHANNELS:
                raise AssetError(f"material map {name!r} is unknown; known are {', '.join(CHANNELS)}.")
            if value.ndim not in (1, 3) or value.shape[-1] != CHANNELS[name]:
                wanted = f"({CHANNELS[name]},) or (rows, cols, {CHANNELS[name]})"
                raise AssetError(f"material map {name!r} has shape {tuple(value.shape)}; wanted {wanted}.")
        if "base_color" not in self.maps:
            raise AssetError("a material needs a 'base_color' map.")
        if "metallic" in self.maps and "roughness" not in self.maps:
            raise AssetError("a material with a 'metallic' map needs a 'roughness' map, too.")

    @classmethod
    def lambertian(cls, base_color: Float[Tensor, "*shape"] | tuple[float, float, float]) -> Material:
        """A diffuse material of constant or textured linear RGB reflectance in [0, 1]."""
        return cls({"base_color": torch.as_tensor(base_color, dtype=torch.float32)})

    @property
    def base_color(self) -> Float[Tensor, "*shape"]:
        return self.maps["base_color"]


@dataclass(frozen=True)
class Materials:
    """One material for each part of a surface, in the order of `Surface.parts`."""

    parts: tuple[Material, ...]

    def __len__(self) -> int:
        return len(self.parts)

    def __getitem__(self, part: int) -> Material:
        return self.parts[part]
