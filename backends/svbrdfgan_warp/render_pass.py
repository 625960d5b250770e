"""One picture, forward from camera samples to pixels, and backward from the pixels' gradient to textures and light."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Set
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import torch
import warp as wp
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.types import Gradients, Materials, Rendering, View
from svbrdfgan_warp import texture_kernels
from svbrdfgan_warp.device import argument, in_order, launch, upload
from svbrdfgan_warp.prepared_scene import FilmChunk, SampleRecords, Tracer

KEPT = {"cpu": 2**22, "cuda": 2**26}
"""Most camera samples whose records are kept for a gradient; the backward pass traces the others again."""


@dataclass(frozen=True, eq=False)
class RenderPass:
    """The inputs of one picture, and the records kept for its gradient.

    Attributes:
        chunks: makes those of the film, which together cover it.
        texels: base colours of all parts, copied when the pass was made.
        kept: records that the backward pass need not trace again.
    """

    tracer: Tracer
    view: View
    chunks: Callable[[], Iterator[FilmChunk]]
    materials: Materials
    atlas: texture_kernels.Atlas
    texels: Float[Tensor, "texels 3"]
    kept: dict[FilmChunk, SampleRecords] = field(default_factory=dict)

    @classmethod
    def of(
        cls, tracer: Tracer, view: View, chunks: Callable[[], Iterator[FilmChunk]], materials: Materials
    ) -> RenderPass:
        """The pass that renders these materials."""
        surface = tracer.surface
        sizes = tuple(tuple(material.base_color.shape[:-1] or (1, 1)) for material in materials.parts)
        atlas = _atlas(sizes, surface.surface.repeat, surface.device)
        return cls(tracer, view, chunks, materials, atlas, _packed(materials, surface.device))

    def forward(self, *, keep: bool = False) -> Rendering:
        """The picture. Unless `keep`, memory holds no more than the picture, the inputs and a few chunks."""
        device, height, width = self.texels.device, self.view.height, self.view.width
        image = torch.empty(height * width, 3, dtype=torch.float32, device=device)
        coverage = torch.empty(height * width, dtype=torch.float32, device=device)
        texels, results = argument(self.texels, wp.vec3), (argument(image, wp.vec3), argument(coverage))

        def render(chunk: FilmChunk) -> SampleRecords:
            records = self.tracer(chunk)
            launch(texture_kernels.gather, chunk.pixels, (self.atlas, *records.arguments(), texels, *results), device)
            return records

        room = KEPT[device.type] if keep else 0
        for records in in_order(render, self.chunks(), device):
            room -= len(records.chunk)
            if room >= 0:
                self.kept[records.chunk] = records
        return Rendering(image.view(height, width, 3), coverage.view(height, width))

    def backward(self, grad_image: Float[Tensor, "height width 3"], wrt: Set[str]) -> Gradients:
        """The gradient of sum(image * grad_image): the transpose of `forward` on the same samples."""
        accumulator = GradientAccumulator.of(self, grad_image, wrt)
        for records in self._records() if wrt else ():
            accumulator.add(records)
        return accumulator.gradients(self.materials)

    def _records(self) -> Iterator[SampleRecords]:
        yield from self.kept.values()
        again = (chunk for chunk in self.chunks() if chunk not in self.kept)
        yield from in_order(self.tracer, again, self.texels.device)


@dataclass(frozen=True, eq=False)
class GradientAccumulator:
    """Sums of gradients over camera samples, in float64: a float32 sum stops growing after about 2^24 additions.

    Only one thread may add: on the CPU, Warp's atomics are plain additions, and the order decides the last bits.

    Attributes:
        atlas, texels: the base colours of all parts.
        grad_image: pixel by pixel.
        grad_texels: sums for the base colours; None if not wanted.
        grad_radiance: sums for the environment's radiance; None if not wanted.
    """

    atlas: texture_kernels.Atlas
    texels: Float[Tensor, "texels 3"]
    grad_image: Float[Tensor, "pixels 3"]
    grad_texels: Float[Tensor, "texels 3"] | None
    grad_radiance: Float[Tensor, "rows cols 3"] | None

    @classmethod
    def of(
        cls, render_pass: RenderPass, grad_image: Float[Tensor, "height width 3"], wrt: Set[str]
    ) -> GradientAccumulator:
        """Sums of zero."""
        texels = render_pass.texels
        device, radiance = texels.device, render_pass.view.environment.radiance
        return cls(
            render_pass.atlas,
            texels,
            grad_image.detach().to(device, torch.float32).reshape(-1, 3).contiguous(),
            _zeros(texels.shape, device) if "base_color" in wrt else None,
            _zeros(radiance.shape, device) if "environment" in wrt else None,
        )

    def add(self, records: SampleRecords) -> None:
        """Adds the gradients that pass through these samples."""
        device, count, grad_image = self.texels.device, len(records.chunk), argument(self.grad_image, wp.vec3)
        if self.grad_texels is not None:
            sums = argument(self.grad_texels, wp.vec3d)
            samples, *hits = records.arguments()
            threads = -(-count // texture_kernels.RECORDS_PER_THREAD)
            given = (self.atlas, samples, count, *hits, grad_image, sums)
            launch(texture_kernels.scatter_texels, threads, given, device)
        if self.grad_radiance is not None:
            light_samples, texels = (argument(tensor, wp.vec3) for tensor in (records.light_samples, self.texels))
            sums = argument(self.grad_radiance, wp.vec3d)
            given = (self.atlas, *records.hits(), light_samples, texels, grad_image, sums)
            launch(texture_kernels.scatter_radiance, count, given, device)

    def gradients(self, materials: Materials) -> Gradients:
        """The sums, each in the shape of its input."""
        environment = None if self.grad_radiance is None else self.grad_radiance.float()
        if self.grad_texels is None:
            return Gradients(tuple({} for _ in materials.parts), environment)
        pieces = _unpacked(self.grad_texels.float(), materials)
        return Gradients(tuple({"base_color": piece} for piece in pieces), environment)


@lru_cache(maxsize=64)
def _atlas(sizes: tuple[tuple[int, int], ...], repeat: tuple[bool, bool], device: torch.device) -> Any:
    """The first texel of each part in `_packed`, and its rows and columns; a constant is one texel."""
    layout, begin = [], 0
    for rows, cols in sizes:
        layout.append((begin, rows, cols))
        begin += rows * cols
    result: Any = texture_kernels.Atlas()
    result.layout = wp.from_torch(torch.tensor(layout, dtype=torch.int32, device=device), dtype=wp.vec3i)
    result.repeat_u, result.repeat_v = repeat
    return result


def _packed(materials: Materials, device: torch.device) -> Float[Tensor, "texels 3"]:
    """The base colours of all parts in one array, part by part and row by row: one kernel serves every scene."""
    colors = (upload(material.base_color.detach(), device) for material in materials.parts)
    return torch.cat([color.to(torch.float32).reshape(-1, 3) for color in colors])


def _unpacked(texels: Float[Tensor, "texels 3"], materials: Materials) -> list[Float[Tensor, ...]]:
    """The inverse of `_packed`: each part's texels in the shape of its base colour."""
    maps = [material.base_color for material in materials.parts]
    pieces = texels.split([m.numel() // 3 for m in maps])
    return [piece.reshape(m.shape) for piece, m in zip(pieces, maps, strict=True)]


def _zeros(shape: torch.Size, device: torch.device) -> Float[Tensor, "*shape"]:
    return torch.zeros(shape, dtype=torch.float64, device=device)
