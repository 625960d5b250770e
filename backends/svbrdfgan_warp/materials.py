"""All maps of all materials in arrays that kernels read, so that one kernel serves every scene; and gradients back."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.types import CHANNELS, Materials
from svbrdfgan_warp import material_kernels, texture_kernels
from svbrdfgan_warp.device import upload

_NEUTRAL = {"base_color": (0.0, 0.0, 0.0), "roughness": (1.0,), "metallic": (0.0,), "normal": (0.0, 0.0, 1.0)}
"""The texel that stands for a map that a part lacks. Only that of `metallic` is ever used."""


def linear_in_base_color(materials: Materials) -> bool:
    """Whether every part is Lambertian without relief, so that a picture is a product with the base colours."""
    return not any(material.maps.keys() - {"base_color"} for material in materials.parts)


@dataclass(frozen=True, eq=False)
class PackedMaps:
    """Copies of all maps, each name in one array: a neutral texel, then part by part and row by row.

    Attributes:
        texels: of each map; maps of one channel have one axis, the others two.
        layouts: of each map, per part, the first texel, rows and columns; a constant is one texel.
        has: per part, whether it has each map, in the order of `CHANNELS`.
        repeat: `Surface.repeat`.
    """

    materials: Materials
    texels: Mapping[str, Float[Tensor, "*texels"]]
    layouts: Mapping[str, Int[Tensor, "parts 3"]]
    has: Int[Tensor, "names parts"]
    repeat: tuple[bool, bool]

    @classmethod
    def of(cls, materials: Materials, repeat: tuple[bool, bool], device: torch.device) -> PackedMaps:
        names, parts = len(CHANNELS), len(materials)
        layouts = [_layout(materials, name) for name in CHANNELS]
        has = [[int(name in material.maps) for material in materials.parts] for name in CHANNELS]
        numbers = torch.cat([torch.tensor(layouts).flatten(), torch.tensor(has).flatten()]).int()
        neutral = torch.tensor([value for name in CHANNELS for value in _NEUTRAL[name]], dtype=torch.float32)
        # One copy instead of a dozen: at few samples a picture's time is that of such calls.
        numbers = upload(torch.cat([numbers, neutral.view(torch.int32)]), device)
        layout, has_map, bits = numbers.split([3 * names * parts, names * parts, len(neutral)])
        first = bits.view(torch.float32).split([len(_NEUTRAL[name]) for name in CHANNELS])
        texels = {name: _joined(materials, name, one) for name, one in zip(CHANNELS, first, strict=True)}
        return cls(
            materials,
            texels,
            dict(zip(CHANNELS, layout.view(names, parts, 3), strict=True)),
            has_map.view(names, parts),
            repeat,
        )

    @property
    def device(self) -> torch.device:
        return self.has.device

    @cached_property
    def atlases(self) -> Mapping[str, texture_kernels.Atlas]:
        """The places of each map's texels, as kernels take them."""
        found = {}
        for name, layout in self.layouts.items():
            atlas: Any = texture_kernels.Atlas()
            atlas.layout = wp.from_torch(layout, dtype=wp.vec3i)
            atlas.repeat_u, atlas.repeat_v = self.repeat
            found[name] = atlas
        return found

    @cached_property
    def argument(self) -> Any:
        """The maps as kernels take them."""
        result: Any = material_kernels.Maps()
        for name in CHANNELS:
            setattr(result, name, as_array(self.texels[name]))
            setattr(result, f"{name}_atlas", self.atlases[name])
        has = dict(zip(CHANNELS, self.has, strict=True))
        result.glossy, result.tilted = wp.from_torch(has["roughness"]), wp.from_torch(has["normal"])
        return result

    def gradients(self, sums: Mapping[str, Float[Tensor, "*texels"]]) -> tuple[dict[str, Tensor], ...]:
        """The sums of each part, by the names of those of its maps that are in `sums`, shaped like the map."""
        pieces = {name: total[1:].float().split(_sizes(self.materials, name)) for name, total in sums.items()}
        return tuple(
            {name: pieces[name][part].reshape(m.maps[name].shape) for name in pieces if name in m.maps}
            for part, m in enumerate(self.materials.parts)
        )

    def present(self, names: Set[str]) -> list[str]:
        """The names among these that are maps of some part, in the order of `CHANNELS`."""
        return [name for name in CHANNELS if name in names and any(name in m.maps for m in self.materials.parts)]


def as_array(tensor: Float[Tensor, "*shape"]) -> Any:
    """A tensor of numbers, or of vectors where its last axis has three, in its own precision."""
    return wp.from_torch(tensor, vector_type(tensor))


def vector_type(tensor: Float[Tensor, "*shape"]) -> Any:
    """The vectors that a tensor holds; None if it holds numbers."""
    if tensor.ndim == 1:
        return None
    return wp.vec3d if tensor.dtype == torch.float64 else wp.vec3


def _joined(materials: Materials, name: str, neutral: Float[Tensor, " channels"]) -> Float[Tensor, "*texels"]:
    channels = CHANNELS[name]
    maps = [material.maps[name].detach() for material in materials.parts if name in material.maps]
    given = [upload(each, neutral.device).to(torch.float32).reshape(-1, channels) for each in maps]
    joined = torch.cat([neutral[None], *given])
    return joined if channels > 1 else joined.squeeze(1)


def _layout(materials: Materials, name: str) -> list[tuple[int, int, int]]:
    """First texel, rows and columns of each part's map; the neutral texel comes before all of them."""
    layout, begin = [], 1
    for material, size in zip(materials.parts, _sizes(materials, name), strict=True):
        rows, cols = material.maps[name].shape[:-1] or (1, 1) if size else (1, 1)
        layout.append((begin if size else 0, rows, cols))
        begin += size
    return layout


def _sizes(materials: Materials, name: str) -> list[int]:
    """The number of texels of each part's map; 0 where there is none."""
    return [m.maps[name].numel() // CHANNELS[name] if name in m.maps else 0 for m in materials.parts]
