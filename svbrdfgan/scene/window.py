"""The window of a close-up: the square of a fine map that a picture shows, baked and painted alone.

A window's surface is the whole mesh, whose UVs are moved and scaled so that the window is the unit square. So whatever
works on a subject works on a window, at the cost of its own texels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from numpy import ndarray
from torch import Tensor

from svbrdfgan.geometry.bake import GeometryBuffer
from svbrdfgan.geometry.camera_hits import camera_hits
from svbrdfgan.geometry.texels import nearest_texels, sample_texture
from svbrdfgan.types import Camera, Surface, channel_slices
from svbrdfgan.weathering.mesh_maps import MeshMaps

WHOLE = 512
"""The most texels along a side of the map in which a window is placed and surveyed, and inner layers of the surface are
hidden."""

_PIXELS = 96
"""Of the longer side of the picture by which a window is placed."""
_STEPS = 16
"""A window starts at a multiple of its side over this."""


@dataclass(frozen=True)
class Window:
    """A square of a map.

    Attributes:
        row, col: of its first texel; row 0 is at v = 0.
        size: texels along a side.
    """

    row: int
    col: int
    size: int


def find_window(
    surface: Surface, learnable: Sequence[int], camera: Camera, aspect: float, size: int, texture: int
) -> Window:
    """The window in which most of what a camera sees of the learnable parts lies; in the map's middle if it sees none.

    Args:
        surface: over the whole map.
        aspect: the picture's width over its height.
        size: of the window, texels; a multiple of 16.
        texture: texels along a side of the map.
    """
    width, height = (max(1, round(_PIXELS * side / max(aspect, 1.0))) for side in (aspect, 1.0))
    hits = camera_hits(surface, camera, width, height)
    seen = hits.hit & np.isin(hits.part, learnable)
    step, last = size // _STEPS, texture - size
    blocks = -(-texture // step)
    cols, rows = (hits.interpolate(surface.uv)[seen].T * (texture / step)).astype(int).clip(0, blocks - 1)
    counts = np.bincount(rows * blocks + cols, minlength=blocks**2).reshape(blocks, blocks)
    inside = _box_sums(counts, _STEPS)[: last // step + 1, : last // step + 1]
    best = np.argwhere(inside == inside.max())
    row, col = best[np.argmin(np.square(best - best.mean(axis=0)).sum(axis=1))]  # of equal ones, that in their midst
    return Window(int(row) * step, int(col) * step, size)


def windowed(surface: Surface, window: Window, texture: int) -> Surface:
    """The surface with UVs in which the window is the unit square; what lies outside has UVs outside."""
    moved = (surface.uv * texture - (window.col, window.row)) / window.size
    return replace(surface, uv=moved, repeat=(False, False), whole_uv=surface.uv)


def place_in_whole(surface: Surface, whole: Surface, share: float) -> tuple[float, float, float, float]:
    """The first row and column of a window, and its rows and columns, over those of the whole map (`Wholes.place`).

    Args:
        surface: with UVs in which the window is the unit square.
        whole: with those of the whole map.
        share: of a side of the map.
    """
    col, row = (whole.uv - share * surface.uv).mean(axis=0).tolist()
    return row, col, share, share


def bordered(values: Float[Tensor, "*shape rows cols channels"]) -> Float[Tensor, "*shape rows cols channels"]:
    """The values of a window's layers, transparent at its border: textures continue outside as they are there."""
    alpha = channel_slices(())["alpha"]
    inner = F.pad(values.new_ones(values.shape[-3] - 2, values.shape[-2] - 2, 1), (0, 0, 1, 1, 1, 1))
    return torch.cat([values[..., : alpha.start], values[..., alpha] * inner, values[..., alpha.stop :]], dim=-1)


def interpolated_survey(buffer: GeometryBuffer, whole: Surface, maps: MeshMaps) -> Float[ndarray, "2 texels"]:
    """Visibility and curvature at the texels of a window, between those of a coarser map of the whole: both are smooth.

    Args:
        buffer: of the window.
        whole: the surface over the whole map.
        maps: of the whole.
    """
    nearest = nearest_texels(buffer.mask.numpy())
    face, barycentric = buffer.face.numpy()[nearest].ravel(), buffer.barycentric.numpy()[nearest].reshape(-1, 3)
    uv = torch.from_numpy(np.einsum("pi,pij->pj", barycentric, whole.uv[whole.faces[face]]))
    return sample_texture(torch.stack([maps.visibility, maps.curvature], dim=-1), uv).T.numpy()


def _box_sums(counts: Int[ndarray, "rows cols"], side: int) -> Int[ndarray, "places places"]:
    """Sums over squares of that side, by their first row and column."""
    total = np.pad(counts, ((1, 0), (1, 0))).cumsum(axis=0).cumsum(axis=1)
    return total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
