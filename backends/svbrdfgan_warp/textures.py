"""The base colours of all parts in one array, so that one kernel serves every scene."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Materials
from svbrdfgan_warp import lookup


def shapes(materials: Materials) -> list[tuple[int, int]]:
    """Rows and columns of each part's base colour; a constant is one texel."""
    maps = [material.base_color for material in materials.parts]
    return [(m.shape[0], m.shape[1]) if m.ndim == 3 else (1, 1) for m in maps]


def pack(materials: Materials, device: torch.device) -> Float[Tensor, "texels 3"]:
    """The texels of all parts, one part after the other, row by row."""
    maps = [material.base_color.detach().to(device, torch.float32).reshape(-1, 3) for material in materials.parts]
    return torch.cat(maps)


def unpack(texels: Float[Tensor, "texels 3"], materials: Materials) -> list[Float[Tensor, ...]]:
    """The inverse of `pack`: for each part, its share of `texels` in the shape of its base colour."""
    maps = [material.base_color for material in materials.parts]
    pieces = texels.split([m.numel() // 3 for m in maps])
    return [piece.reshape(m.shape) for piece, m in zip(pieces, maps, strict=True)]


def atlas(sizes: Sequence[tuple[int, int]], repeat: tuple[bool, bool], device: torch.device) -> lookup.Atlas:
    """Where each part's texels begin, and how many rows and columns they have."""
    layout, begin = [], 0
    for rows, cols in sizes:
        layout.append((begin, rows, cols))
        begin += rows * cols
    result: Any = lookup.Atlas()
    result.layout = wp.from_torch(torch.tensor(layout, dtype=torch.int32, device=device), dtype=wp.vec3i)
    result.repeat_u, result.repeat_v = repeat
    return result
