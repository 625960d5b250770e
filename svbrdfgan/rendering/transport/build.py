"""From a renderer's samples to a stored transport, merging entries of the same pixel and texel in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.rendering.texture_filter import Repeat, bilinear_taps, sample_texture
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.merge import Entries, Runs, segment_sums
from svbrdfgan.types import Materials, TransportSamples, View
from svbrdfgan.utils.copy_async import copy_async
from svbrdfgan.utils.deprecation import renamed_keyword

_MERGE_AT = 16_000_000
"""Entries that may wait to be merged, beside those of one chunk: 24 bytes each."""


@renamed_keyword("guide", "gbuffer")
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

    The same chunks give the same transport, to the last bit. Merging takes some 250 bytes for each sample of a chunk.

    Args:
        samples: what `TransportRenderer.transport` yields.
        materials: of all parts; those of learnable ones do not matter.
        learnable: the parts whose textures stay variable, at the resolution of `gbuffer`.
        gbuffer: position and normal of each texel; the transport keeps them as seen from the camera.
        spp: samples per pixel that were traced, hits or not.
    """
    columns = _Columns.of(len(materials), tuple(learnable), (gbuffer.shape[0], gbuffer.shape[1]), repeat)
    pending: list[Entries] = []
    waiting = 0
    for chunk in samples:
        columns, gbuffer = columns.to(chunk.uv.device), copy_async(gbuffer, chunk.uv.device)
        pending.append(_entries(chunk, _reflected(chunk, materials, learnable, repeat), columns).merged())
        waiting += len(pending[-1].key)
        if waiting > _MERGE_AT:
            pending, waiting = [_merged(pending)], 0
    return _stored(_merged(pending), columns, gbuffer, view, spp)


@dataclass(frozen=True, eq=False)
class _Columns:
    """The columns of T: the texels of all textures, and one more for what is constant.

    Attributes:
        texture: for every part, its texture; -1 where it is constant.
        parts: the part of every texture.
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
        """How many there are of all textures, and thereby the constant column."""
        return len(self.parts) * self.shape[0] * self.shape[1]

    def __len__(self) -> int:
        return self.texels + 1

    def column(self, part: Int[Tensor, "*shape"], texel: Int[Tensor, "*shape"]) -> Int[Tensor, "*shape"]:
        """Of a texel (row * cols + col) of a part."""
        texture = self.texture[part]
        return torch.where(texture < 0, self.texels, texture * (self.shape[0] * self.shape[1]) + texel)


def _merged(pending: Sequence[Entries]) -> Entries:
    """All that is pending, each part of which is merged already."""
    if not pending:
        return Entries(torch.zeros(0, dtype=torch.long), torch.zeros(0, 4))
    return pending[0] if len(pending) == 1 else Entries.joined(pending).merged()


def _reflected(
    chunk: TransportSamples, materials: Materials, learnable: Sequence[int], repeat: Repeat
) -> Float[Tensor, "samples 3"]:
    """The weights, times the reflectance of parts that are not learnable."""
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
        mine = (chunk.part == part).nonzero().squeeze(1)
        reflectance[mine] = sample_texture(base, chunk.uv[mine], repeat)
    return chunk.weight * reflectance


def _entries(chunk: TransportSamples, weight: Float[Tensor, "samples 3"], columns: _Columns) -> Entries:
    """Entries by pixel * columns + column: RGB weight, and how many samples look there.

    Samples of one pixel between the same four texels are summed before they are spread over these: there are far fewer
    such groups than samples, and the long sort is of samples, not of their four taps.
    """
    pixel, part = chunk.pixel.long(), chunk.part.long()
    texel, tap = bilinear_taps(chunk.uv, *columns.shape, columns.repeat)
    row = pixel * len(columns)
    runs = Runs.of(row + columns.column(part, texel[:, 0]))
    value = torch.cat([weight, torch.ones_like(weight[:, :1])], dim=1)
    spread = tap[runs.order].unsqueeze(2) * value[runs.order].unsqueeze(1)
    first = runs.first()
    key = row[first].unsqueeze(1) + columns.column(part[first].unsqueeze(1), texel[first])
    return Entries(key.flatten(), segment_sums(spread.flatten(1), runs.length).reshape(-1, 4))


def _stored(
    entries: Entries, columns: _Columns, gbuffer: Float[Tensor, "rows cols 6"], view: View, spp: int
) -> LightTransport:
    """The constant column becomes the background; the others, looked up in the G-buffer, tell what a pixel shows."""
    film, device = (view.height, view.width), entries.key.device
    edges = torch.arange(film[0] * film[1] + 1, device=device) * len(columns)
    column = entries.key % len(columns)
    constant = (column == columns.texels).nonzero().squeeze(1)
    kept = (column < columns.texels).nonzero().squeeze(1)
    texel, value = column[kept], entries.value[kept]
    start = torch.searchsorted(entries.key[kept], edges)
    background = torch.zeros(film[0] * film[1], 3, device=device)
    background[entries.key[constant] // len(columns)] = entries.value[constant, :3]
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
