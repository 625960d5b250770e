"""All maps of all materials in arrays that kernels read, so that one kernel serves every scene; and gradients back."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.types import Materials
from svbrdfgan.types.material import CHANNELS
from svbrdfgan_warp import material_kernels, texture_kernels

_NEUTRAL = {"roughness": (1.0,), "metallic": (0.0,), "normal": (0.0, 0.0, 1.0)}
"""What stands for a map that a part lacks. Kernels read it nowhere, or as what the conventions give."""


def linear_in_base_color(materials: Materials) -> bool:
    """Whether every part is Lambertian without relief, so that a picture is a product with the base colours."""
    return not any(material.maps.keys() - {"base_color"} for material in materials.parts)


@dataclass(frozen=True, eq=False)
class PackedMaps:
    """Copies of all maps, each name in one array, part by part and row by row.

    Attributes:
        texels: of each map; maps of one channel have one axis, the others two.
        layouts: of each map, per part, the first texel, rows and columns; a constant is one texel.
        repeat: `Surface.repeat`.
    """

    materials: Materials
    texels: Mapping[str, Float[Tensor, "*texels"]]
    layouts: Mapping[str, Int[Tensor, "parts 3"]]
    repeat: tuple[bool, bool]

    @classmethod
    def of(cls, materials: Materials, repeat: tuple[bool, bool], device: torch.device) -> PackedMaps:
        texels, layouts = {}, {}
        for name, channels in CHANNELS.items():
            maps = [_map(material.maps, name, device) for material in materials.parts]
            joined = torch.cat([each.reshape(-1, channels) for each in maps])
            texels[name] = joined if channels > 1 else joined.squeeze(1)
            layouts[name] = _layout(maps, device)
        return cls(materials, texels, layouts, repeat)

    @property
    def device(self) -> torch.device:
        return self.texels["base_color"].device

    def atlas(self, name: str) -> texture_kernels.Atlas:
        """Where a map's texels are, as kernels take it."""
        result: Any = texture_kernels.Atlas()
        result.layout = wp.from_torch(self.layouts[name], dtype=wp.vec3i)
        result.repeat_u, result.repeat_v = self.repeat
        return result

    def argument(self) -> material_kernels.Maps:
        """The maps as kernels take them."""
        result: Any = material_kernels.Maps()
        for name in CHANNELS:
            setattr(result, name, as_array(self.texels[name]))
            setattr(result, f"{name}_atlas", self.atlas(name))
        result.glossy, result.tilted = self._flags("roughness"), self._flags("normal")
        return result

    def gradients(self, sums: Mapping[str, Float[Tensor, "*texels"]]) -> tuple[dict[str, Tensor], ...]:
        """Per part, the sums over the texels of those of its maps that are in `sums`, shaped like the map."""
        pieces = {name: total.float().split(self._sizes(name)) for name, total in sums.items()}
        return tuple(
            {name: pieces[name][part].reshape(m.maps[name].shape) for name in pieces if name in m.maps}
            for part, m in enumerate(self.materials.parts)
        )

    def present(self, names: Set[str]) -> list[str]:
        """Those of the names that are maps of some part."""
        return [name for name in CHANNELS if name in names and any(name in m.maps for m in self.materials.parts)]

    def _sizes(self, name: str) -> list[int]:
        """The number of each part's texels."""
        maps = [material.maps.get(name) for material in self.materials.parts]
        return [1 if each is None else each.numel() // CHANNELS[name] for each in maps]

    def _flags(self, name: str) -> Any:
        has = [int(name in material.maps) for material in self.materials.parts]
        return wp.from_torch(torch.tensor(has, dtype=torch.int32, device=self.device))


def as_array(tensor: Float[Tensor, "*shape"]) -> Any:
    """A tensor of numbers, or of vectors where its last axis has three, in its own precision."""
    if tensor.ndim == 1:
        return wp.from_torch(tensor)
    return wp.from_torch(tensor, dtype=wp.vec3d if tensor.dtype == torch.float64 else wp.vec3)


def _map(maps: Mapping[str, Tensor], name: str, device: torch.device) -> Float[Tensor, "*shape"]:
    given = maps[name] if name in maps else torch.tensor(_NEUTRAL[name])
    return given.detach().to(device, torch.float32)


def _layout(maps: list[Tensor], device: torch.device) -> Int[Tensor, "parts 3"]:
    layout, begin = [], 0
    for each in maps:
        rows, cols = each.shape[:-1] or (1, 1)
        layout.append((begin, rows, cols))
        begin += rows * cols
    return torch.tensor(layout, dtype=torch.int32, device=device)
