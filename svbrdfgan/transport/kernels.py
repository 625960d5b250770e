"""The product of stored transports on CUDA: Triton kernels that read the entries of every view where they lie.

A program takes ROWS pixels of one view, and LANES entries of each pixel at a time. What moves is the entries, 10 bytes
each with half weights, the texels that they name, and the pictures. Nothing is copied to make a batch but addresses.
"""
# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: N803

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import accumulate
from typing import Any

import torch
import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
import triton.language as tl  # type: ignore[import-not-found, import-untyped, unused-ignore]
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.transport.record import LightTransport
from svbrdfgan.transport.transfer import send

TILE = {"ROWS": 16, "LANES": 16, "num_warps": 4}


@triton.jit
def program(views, pixels, HALF: tl.constexpr, ROWS: tl.constexpr):
    """The addresses of the program's view, and its pixels with their first and last entries."""
    view = views + tl.program_id(1) * 6
    start = tl.load(view).to(tl.pointer_type(tl.int32))
    texel = tl.load(view + 1).to(tl.pointer_type(tl.int32))
    weight = tl.load(view + 2).to(tl.pointer_type(tl.float16 if HALF else tl.float32))
    scale = tl.load(tl.load(view + 3).to(tl.pointer_type(tl.float32)))
    background = tl.load(view + 4).to(tl.pointer_type(tl.float32))
    pixel = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
    first = tl.load(start + pixel, mask=pixel < pixels, other=0)
    last = tl.load(start + pixel + 1, mask=pixel < pixels, other=0)
    return texel, weight, scale, background, tl.load(view + 5), pixel, first, last


@triton.jit
def picture(views, textures, image, pixels, HALF: tl.constexpr, ROWS: tl.constexpr, LANES: tl.constexpr):
    """image = background + T @ textures."""
    texel, weight, scale, background, offset, pixel, first, last = program(views, pixels, HALF, ROWS)
    red = tl.zeros([ROWS, LANES], tl.float32)
    green = tl.zeros([ROWS, LANES], tl.float32)
    blue = tl.zeros([ROWS, LANES], tl.float32)
    for done in range(0, tl.max(last - first, axis=0), LANES):
        entry = first[:, None] + done + tl.arange(0, LANES)[None, :]
        there = entry < last[:, None]
        color = textures + (offset + tl.load(texel + entry, mask=there, other=0)) * 3
        share = weight + entry * 3
        red += tl.load(share, mask=there, other=0).to(tl.float32) * tl.load(color, mask=there, other=0)
        green += tl.load(share + 1, mask=there, other=0).to(tl.float32) * tl.load(color + 1, mask=there, other=0)
        blue += tl.load(share + 2, mask=there, other=0).to(tl.float32) * tl.load(color + 2, mask=there, other=0)
    behind = background + pixel * 3
    shown = image + (tl.program_id(1).to(tl.int64) * pixels + pixel) * 3
    inside = pixel < pixels
    tl.store(shown, tl.load(behind, mask=inside, other=0) + scale * tl.sum(red, axis=1), mask=inside)
    tl.store(shown + 1, tl.load(behind + 1, mask=inside, other=0) + scale * tl.sum(green, axis=1), mask=inside)
    tl.store(shown + 2, tl.load(behind + 2, mask=inside, other=0) + scale * tl.sum(blue, axis=1), mask=inside)


@triton.jit
def transposed(views, grad_image, grad_textures, pixels, HALF: tl.constexpr, ROWS: tl.constexpr, LANES: tl.constexpr):
    """grad_textures += T^T @ grad_image."""
    texel, weight, scale, _, offset, pixel, first, last = program(views, pixels, HALF, ROWS)
    grad = grad_image + (tl.program_id(1).to(tl.int64) * pixels + pixel) * 3
    red = scale * tl.load(grad, mask=pixel < pixels, other=0)
    green = scale * tl.load(grad + 1, mask=pixel < pixels, other=0)
    blue = scale * tl.load(grad + 2, mask=pixel < pixels, other=0)
    for done in range(0, tl.max(last - first, axis=0), LANES):
        entry = first[:, None] + done + tl.arange(0, LANES)[None, :]
        there = entry < last[:, None]
        color = grad_textures + (offset + tl.load(texel + entry, mask=there, other=0)) * 3
        share = weight + entry * 3
        tl.atomic_add(color, tl.load(share, mask=there, other=0) * red[:, None], mask=there, sem="relaxed")
        tl.atomic_add(color + 1, tl.load(share + 1, mask=there, other=0) * green[:, None], mask=there, sem="relaxed")
        tl.atomic_add(color + 2, tl.load(share + 2, mask=there, other=0) * blue[:, None], mask=there, sem="relaxed")


@dataclass(frozen=True, eq=False)
class KernelProduct:
    """The kernels over a batch.

    Attributes:
        transports: what the addresses point into.
        addresses: for each of them, those of start, texel, weight, scale and background, and its first texel.
        half: whether weights are in half precision, rather than single.
    """

    transports: tuple[LightTransport, ...]
    addresses: Int[Tensor, "views 6"]
    half: bool

    @classmethod
    def of(cls, transports: tuple[LightTransport, ...]) -> KernelProduct:
        half = all(t.weight.dtype == torch.float16 for t in transports)
        kept = transports if half else tuple(replace(t, weight=t.weight.float()) for t in transports)
        first = accumulate((t.texels for t in kept), initial=0)
        rows = [
            [*(tensor.data_ptr() for tensor in (t.start, t.texel, t.weight, t.scale, t.background)), texel]
            for t, texel in zip(kept, first, strict=False)
        ]
        return cls(kept, send(torch.tensor(rows), kept[0].texel.device), half)

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        image = texels.new_empty(len(self.transports) * self._pixels, 3)
        self._launch(picture, texels, image)
        return image

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        texels = grad.new_zeros(sum(t.texels for t in self.transports), 3)
        self._launch(transposed, grad, texels)
        return texels

    @property
    def _pixels(self) -> int:
        return len(self.transports[0].start) - 1

    def _launch(self, kernel: Any, source: Tensor, target: Tensor) -> None:
        grid = (triton.cdiv(self._pixels, TILE["ROWS"]), len(self.transports))
        with torch.cuda.device_of(source):
            kernel[grid](self.addresses, source, target, self._pixels, self.half, **TILE)
