"""Builds a light transport from a renderer's samples, merging entries of one pixel and texel in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.geometry.texels import Repeat, bilinear_taps, sample_texture
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.merge import Entries, Runs, segment_sums
from svbrdfgan.types import Materials, TransportSamples, View
from svbrdfgan.utils.copy_async import copy_async

_MERGE_AT = 16_000_000
"""New entries, of 24 bytes each, that are collected before they are merged with all others."""


def build_transport(
    samples: Iterable[TransportSamples],
    *,
    materials: Materials,
    learnable: Sequence[int],
    gbuffer: Float[Tensor, "rows cols 6"],
    view: View,
    spp: int,
    repeat: Repeat = (False, False),
) -> LightTransport:
    """The transport of one view, in single precision, on the device of the samples.

    The same chunks give the same transport, bit for bit. Merging takes some 250 bytes for each sample of a chunk.

    Args:
        samples: what `TransportRenderer.transport` yields.
        materials: of all parts; those of learnable parts are ignored.
        learnable: the parts whose textures stay variable, at the resolution of `gbuffer`.
        gbuffer: position and normal of each texel; the transport keeps them as seen from the camera.
        spp: samples per pixel that were traced, including those that hit nothing.
    """
    columns = _Columns.of(len(materials), tuple(learnable), (gbuffer.shape[0], gbuffer.shape[1]), repeat)
    pending: list[Entries] = []
    count = 0
    for chunk in samples:
        columns, gbuffer = columns.to(chunk.uv.device), copy_async(gbuffer, chunk.uv.device)
        pending.append(_entries(chunk, _reflected(chunk, materials, learnable, repeat), columns).merged())
        count += len(pending[-1].key)
        if count > _MERGE_AT:
            pending, count = [_merged(pending)], 0  # new entries alone count, or every chunk would cause a merge
    return _transport(_merged(pending), columns, gbuffer, view, spp)


@dataclass(frozen=True, eq=False)
class _Columns:
    """The columns of T: the texels of all textures, and one more column for all constant parts.

    Attributes:
        texture: the texture of each part; -1 for a constant part.
        parts: the part of each texture.
        shape: (rows, cols) of each texture.
    """

    texture: Int[Tensor, " parts"]
    parts: tuple[int, ...]
    shape: tuple[int, int]
    repeat: Repeat

    @classmethod
    def of(cls, count: int, learnable: tuple[int, ...], shape: tuple[int, int], repeat: Repeat) -> _Columns:
        texture = torch.full((count,), -1)
        texture[list(learnable)] = torch.arange(len(learnable))
        return cls(texture, learnable, shape, repeat)

    def to(self, device: torch.device) -> _Columns:
        return _Columns(copy_async(self.texture, device), self.parts, self.shape, self.repeat)

    @property
    def texels(self) -> int:
        """Texels of all textures, which is also the index of the constant column."""
        return len(self.parts) * self.shape[0] * self.shape[1]

    def __len__(self) -> int:
        return self.texels + 1

    def column(self, part: Int[Tensor, "*shape"], texel: Int[Tensor, "*shape"]) -> Int[Tensor, "*shape"]:
        """The column of a texel (row * cols + col) of a part."""
        texture = self.texture[part]
        return torch.where(texture < 0, self.texels, texture * (self.shape[0] * self.shape[1]) + texel)


def _merged(pending: Sequence[Entries]) -> Entries:
    """The entries of all chunks, each of which is merged already."""
    if not pending:
        return Entries(torch.zeros(0, dtype=torch.long), torch.zeros(0, 4))
    return pending[0] if len(pending) == 1 else Entries.joined(pending).merged()


def _reflected(
    chunk: TransportSamples, materials: Materials, learnable: Sequence[int], repeat: Repeat
) -> Float[Tensor, "samples 3"]:
    """The weights, multiplied by the reflectance of parts that are not learnable."""
    constant = [part for part in range(len(materials)) if part not in learnable]
    if not constant:
        return chunk.weight
    color = torch.ones(len(materials), 3)
    maps = {}
    for part in constant:
        base = materials.parts[part].base_color
        if base.ndim == 1:
            color[part] = base
        else:
            maps[part] = base.to(chunk.weight)
    reflectance = color.to(chunk.weight)[chunk.part.long()]
    for part, base in maps.items():
        hit = (chunk.part == part).nonzero().squeeze(1)
        reflectance[hit] = sample_texture(base, chunk.uv[hit], repeat)
    return chunk.weight * reflectance


def _entries(chunk: TransportSamples, weight: Float[Tensor, "samples 3"], columns: _Columns) -> Entries:
    """Entries by pixel * columns + column: RGB weight, and the number of samples."""
    # Samples of one pixel between the same four texels are summed before they are spread over the four: there are far
    # fewer such groups than samples, and the long sort is of samples, not of four times as many taps.
    pixel, part = chunk.pixel.long(), chunk.part.long()
    texel, tap = bilinear_taps(chunk.uv, *columns.shape, columns.repeat)
    row = pixel * len(columns)
    runs = Runs.of(row + columns.column(part, texel[:, 0]))
    value = torch.cat([weight, torch.ones_like(weight[:, :1])], dim=1)
    taps = tap[runs.order].unsqueeze(2) * value[runs.order].unsqueeze(1)
    first = runs.first()
    key = row[first].unsqueeze(1) + columns.column(part[first].unsqueeze(1), texel[first])
    return Entries(key.flatten(), segment_sums(taps.flatten(1), runs.length).reshape(-1, 4))


def _transport(
    entries: Entries, columns: _Columns, gbuffer: Float[Tensor, "rows cols 6"], view: View, spp: int
) -> LightTransport:
    """The constant column becomes the background; the others also carry the G-buffer into the picture."""
    film, device = (view.height, view.width), entries.key.device
    edges = torch.arange(film[0] * film[1] + 1, device=device) * len(columns)
    column = entries.key % len(columns)
    constant = (column == columns.texels).nonzero().squeeze(1)
    kept = (column < columns.texels).nonzero().squeeze(1)
    texel, value = column[kept], entries.value[kept]
    start = torch.searchsorted(entries.key[kept], edges)
    background = torch.zeros(film[0] * film[1], 3, device=device)
    background[entries.key[constant] // len(columns)] = entries.value[constant, :3]
    # rounded, since the taps of one sample sum to one only up to rounding errors
    count = segment_sums(entries.value[:, 3], torch.searchsorted(entries.key, edges).diff()).round()
    shown = gbuffer.reshape(-1, 6)[texel % (columns.shape[0] * columns.shape[1])] * value[:, 3:]
    return LightTransport(
        start=start.int(),
        texel=texel.int(),
        weight=value[:, :3].contiguous(),
        scale=torch.ones((), device=device),
        background=background.reshape(*film, 3),
        coverage=(count / spp).reshape(film),
        gbuffer=(segment_sums(shown, start.diff()) / spp).reshape(*film, 6),
        parts=columns.parts,
        texture_shape=columns.shape,
    )
