"""Texels of the UV square, with centres at (i + 0.5) / n: the bilinear texture filter, and the nearest of a mask."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.ndimage import distance_transform_edt
from torch import Tensor

from svbrdfgan.types import Surface

Repeat = tuple[bool, bool]


def bilinear_taps(
    uv: Float[Tensor, "points 2"], rows: int, cols: int, repeat: Repeat = (False, False)
) -> tuple[Int[Tensor, "points 4"], Float[Tensor, "points 4"]]:
    """The four texels (row * cols + col) around each point and their weights, which sum to one."""
    left, right, across = _axis(uv[:, 0], cols, repeat[0])
    below, above, up = _axis(uv[:, 1], rows, repeat[1])
    index = torch.stack([below * cols + left, below * cols + right, above * cols + left, above * cols + right], dim=1)
    weight = torch.stack([(1 - up) * (1 - across), (1 - up) * across, up * (1 - across), up * across], dim=1)
    return index, weight


def sample_texture(
    texture: Float[Tensor, "rows cols channels"], uv: Float[Tensor, "points 2"], repeat: Repeat = (False, False)
) -> Float[Tensor, "points channels"]:
    """The texture's value at each point."""
    rows, cols, channels = texture.shape
    index, weight = bilinear_taps(uv, rows, cols, repeat)
    return (texture.reshape(-1, channels)[index] * weight.unsqueeze(-1).to(texture.dtype)).sum(dim=1)


def nearest_texels(mask: Bool[ndarray, "rows cols"]) -> tuple[Int[ndarray, "rows cols"], Int[ndarray, "rows cols"]]:
    """Row and column of the nearest texel inside the mask, for every texel."""
    row, col = distance_transform_edt(~mask, return_distances=False, return_indices=True)
    return row, col


def centroid_texels(surface: Surface, rows: int, cols: int) -> Int[ndarray, " faces"]:
    """The texel (row * cols + col) in which each face's centroid lies."""
    middle = surface.uv[surface.faces].mean(axis=1) * (cols, rows)
    col, row = np.minimum(middle.astype(np.int64), (cols - 1, rows - 1)).T
    return row * cols + col


def _axis(coordinate: Tensor, size: int, repeat: bool) -> tuple[Tensor, Tensor, Tensor]:
    position = coordinate * size - 0.5
    if not repeat:
        position = position.clamp(0, size - 1)
    lower = position.floor()
    fraction = position - lower
    low = lower.long()
    if repeat:
        return low % size, (low + 1) % size, fraction
    return low, (low + 1).clamp(max=size - 1), fraction
