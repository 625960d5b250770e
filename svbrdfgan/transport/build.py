"""From a renderer's samples to a stored transport, merging entries of the same pixel and texel in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.texture_filter import Repeat, bilinear_taps, sample_texture
from svbrdfgan.transport.record import LightTransport
from svbrdfgan.types import Materials, TransportSamples, View

_MERGE_AT = 16_000_000
"""Unmerged entries held at most, beside those of one chunk: 28 bytes each."""


@dataclass(frozen=True, eq=False)
class _Entries:
    """Entries of T: a key (pixel * texels + texel) and an RGB weight each."""

    key: Int[Tensor, " entries"]
    weight: Float[Tensor, "entries 3"]

    def merged(self) -> _Entries:
        """Sorted, each key once."""
        key, inverse = torch.unique(self.key, return_inverse=True)
        weight = self.weight.new_zeros(len(key), 3).index_add_(0, inverse, self.weight)
        return _Entries(key, weight)


def build_transport(
    samples: Iterable[TransportSamples],
    *,
    materials: Materials,
    learnable: Sequence[int],
    guide: Float[Tensor, "rows cols 6"],
    view: View,
    spp: int,
    repeat: Repeat = (False, False),
) -> LightTransport:
    """The transport of one view, in single precision, on the device of the samples.

    Args:
        samples: what `TransportRenderer.transport` yields.
        materials: of all parts; those of learnable ones do not matter.
        learnable: the parts whose textures stay variable, at the resolution of `guide`.
        guide: what the generator sees of the surface, kept as seen from the camera.
        spp: samples per pixel that were traced, hits or not.
    """
    rows, cols, _ = guide.shape
    pixels, texels = view.height * view.width, len(learnable) * rows * cols
    slot = torch.full((len(materials),), -1, dtype=torch.long)
    slot[list(learnable)] = torch.arange(len(learnable))
    background, coverage, seen = torch.zeros(pixels, 3), torch.zeros(pixels), torch.zeros(pixels, 6)
    pending = _Entries(torch.zeros(0, dtype=torch.long), torch.zeros(0, 3))
    for chunk in samples:
        device = chunk.uv.device
        slot, background, coverage, seen = (t.to(device) for t in (slot, background, coverage, seen))
        pixel = chunk.pixel.long()
        coverage.index_add_(0, pixel, torch.full(pixel.shape, 1.0 / spp, device=device))
        _add_constant_parts(background, chunk, materials, learnable, repeat)
        texture = slot[chunk.part.long()]
        chosen = texture >= 0
        index, tap = bilinear_taps(chunk.uv[chosen], rows, cols, repeat)
        seen.index_add_(0, pixel[chosen], sample_texture(guide.to(device), chunk.uv[chosen], repeat) / spp)
        entries = _expand(pixel[chosen] * texels + texture[chosen] * (rows * cols), index, tap, chunk.weight[chosen])
        pending = _Entries(
            torch.cat([pending.key.to(device), entries.key]), torch.cat([pending.weight.to(device), entries.weight])
        )
        if len(pending.key) > _MERGE_AT:
            pending = pending.merged()
    merged = pending.merged()
    pixel = torch.div(merged.key, max(texels, 1), rounding_mode="floor")
    edges = torch.arange(pixels + 1, device=pixel.device)
    return LightTransport(
        start=torch.searchsorted(pixel, edges).int(),
        texel=(merged.key % max(texels, 1)).int(),
        weight=merged.weight,
        scale=torch.ones((), device=pixel.device),
        background=background.reshape(view.height, view.width, 3),
        coverage=coverage.reshape(view.height, view.width),
        guide=seen.reshape(view.height, view.width, 6),
        parts=tuple(learnable),
        texture_shape=(rows, cols),
    )


def _expand(row: Tensor, index: Tensor, tap: Tensor, weight: Tensor) -> _Entries:
    """One entry for each of the four taps of each sample, merged: neighbours share most of them."""
    key = (row.unsqueeze(1) + index).reshape(-1)
    return _Entries(key, (tap.unsqueeze(-1) * weight.unsqueeze(1)).reshape(-1, 3)).merged()


def _add_constant_parts(
    background: Tensor, chunk: TransportSamples, materials: Materials, learnable: Sequence[int], repeat: Repeat
) -> None:
    color = torch.zeros(len(materials), 3)
    for part, material in enumerate(materials.parts):
        if part in learnable:
            continue
        if material.base_color.ndim == 1:
            color[part] = material.base_color
            continue
        mine = chunk.part == part
        reflectance = sample_texture(material.base_color.to(chunk.uv.device), chunk.uv[mine], repeat)
        background.index_add_(0, chunk.pixel[mine].long(), chunk.weight[mine] * reflectance)
    constant = color.to(chunk.weight.device)[chunk.part.long()]
    background.index_add_(0, chunk.pixel.long(), chunk.weight * constant)
