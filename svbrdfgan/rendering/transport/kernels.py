"""The product of stored transports on CUDA: Triton kernels that read the entries of every view where they lie.

What moves is the entries, 10 bytes each with half weights, the texels that they name, and the pictures. Nothing is
copied to make a batch but addresses.
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

from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.utils.copy_async import copy_async

PICTURE = {"ROWS": 8, "LANES": 16, "num_warps": 1}
"""Pixels of a program, and entries of each of them at a time."""

TRANSPOSED = {"HALVINGS": 4, "ENTRIES": 256, "num_warps": 2}
"""A program has 2^HALVINGS pixels, and takes so many of their entries at a time."""


@triton.jit
def view_of(views, HALF: tl.constexpr):
    """The addresses of the program's view, its scale and its first texel."""
    view = views + tl.program_id(1) * 6
    start = tl.load(view).to(tl.pointer_type(tl.int32))
    texel = tl.load(view + 1).to(tl.pointer_type(tl.int32))
    weight = tl.load(view + 2).to(tl.pointer_type(tl.float16 if HALF else tl.float32))
    scale = tl.load(tl.load(view + 3).to(tl.pointer_type(tl.float32)))
    background = tl.load(view + 4).to(tl.pointer_type(tl.float32))
    return start, texel, weight, scale, background, tl.load(view + 5)


@triton.jit
def color_of(address, there):
    """Three numbers in a row at each address."""
    red = tl.load(address, mask=there, other=0).to(tl.float32)
    green = tl.load(address + 1, mask=there, other=0).to(tl.float32)
    return red, green, tl.load(address + 2, mask=there, other=0).to(tl.float32)


@triton.jit
def picture(
    views,
    textures,
    image,
    pixels,
    HALF: tl.constexpr,
    BACKGROUND: tl.constexpr,
    ROWS: tl.constexpr,
    LANES: tl.constexpr,
):
    """image = T @ textures, before the background if there is to be one."""
    start, texel, weight, scale, background, offset = view_of(views, HALF)
    pixel = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
    inside = pixel < pixels
    first = tl.load(start + pixel, mask=inside, other=0)
    last = tl.load(start + pixel + 1, mask=inside, other=0)
    behind_red = tl.zeros([ROWS], tl.float32)
    behind_green = tl.zeros([ROWS], tl.float32)
    behind_blue = tl.zeros([ROWS], tl.float32)
    if BACKGROUND:
        behind_red, behind_green, behind_blue = color_of(background + pixel * 3, inside)
    textures += offset * 3
    red = tl.zeros([ROWS, LANES], tl.float32)
    green = tl.zeros([ROWS, LANES], tl.float32)
    blue = tl.zeros([ROWS, LANES], tl.float32)
    for done in range(0, tl.max(last - first, axis=0), LANES):
        entry = first[:, None] + done + tl.arange(0, LANES)[None, :]
        there = entry < last[:, None]
        place = tl.load(texel + entry, mask=there, other=0).to(tl.int64)
        share_red, share_green, share_blue = color_of(weight + entry.to(tl.int64) * 3, there)
        color_red, color_green, color_blue = color_of(textures + place * 3, there)
        red += share_red * color_red
        green += share_green * color_green
        blue += share_blue * color_blue
    shown = image + (tl.program_id(1).to(tl.int64) * pixels + pixel) * 3
    tl.store(shown, behind_red + scale * tl.sum(red, axis=1), mask=inside)
    tl.store(shown + 1, behind_green + scale * tl.sum(green, axis=1), mask=inside)
    tl.store(shown + 2, behind_blue + scale * tl.sum(blue, axis=1), mask=inside)


@triton.jit
def row_of(entry, start, rows, HALVINGS: tl.constexpr):
    """The last of 2^HALVINGS rows to start at or before each entry, by bisection; only the first `rows` exist."""
    row = tl.zeros_like(entry)
    for halving in tl.static_range(HALVINGS):
        middle = row + (1 << (HALVINGS - 1 - halving))
        first = tl.load(start + middle, mask=middle < rows, other=2147483647)
        row = tl.where(first <= entry, middle, row)
    return row


@triton.jit
def add_color(color, red, green, blue, there, CHANNELS: tl.constexpr):
    """Adds at each address: three numbers one by one, or those and a zero, aligned, which sm_90 adds at once."""
    if CHANNELS == 4:
        pairs = tl.join(tl.join(red, blue), tl.join(green, tl.zeros_like(red)))
        channel = color[:, None] + tl.arange(0, 4)[None, :]
        tl.atomic_add(channel, pairs.reshape(red.shape[0], 4), mask=there[:, None], sem="relaxed")
    else:
        tl.atomic_add(color, red, mask=there, sem="relaxed")
        tl.atomic_add(color + 1, green, mask=there, sem="relaxed")
        tl.atomic_add(color + 2, blue, mask=there, sem="relaxed")


@triton.jit
def transposed(
    views,
    grad_image,
    grad_textures,
    pixels,
    HALF: tl.constexpr,
    CHANNELS: tl.constexpr,
    HALVINGS: tl.constexpr,
    ENTRIES: tl.constexpr,
):
    """grad_textures += T^T @ grad_image. No lane is idle for a short row: entries are taken as they lie."""
    start, texel, weight, scale, _, offset = view_of(views, HALF)
    pixel = tl.program_id(0) << HALVINGS
    first = tl.load(start + pixel)
    last = tl.load(start + tl.minimum(pixel + (1 << HALVINGS), pixels))
    grad = grad_image + (tl.program_id(1).to(tl.int64) * pixels + pixel) * 3
    grad_textures += offset * CHANNELS
    for done in range(first, last, ENTRIES):
        entry = done + tl.arange(0, ENTRIES)
        there = entry < last
        place = tl.load(texel + entry, mask=there, other=0).to(tl.int64)
        share_red, share_green, share_blue = color_of(weight + entry.to(tl.int64) * 3, there)
        row = row_of(entry, start + pixel, pixels - pixel, HALVINGS)
        red, green, blue = color_of(grad + row * 3, there)
        color = grad_textures + place * CHANNELS
        red, green, blue = scale * share_red * red, scale * share_green * green, scale * share_blue * blue
        add_color(color, red, green, blue, there, CHANNELS)


@dataclass(frozen=True, eq=False)
class KernelProduct:
    """The kernels over a batch.

    Attributes:
        transports: what the addresses point into.
        addresses: for each of them, those of start, texel, weight, scale and background, and its first texel.
        half: whether weights are in half precision, rather than single.
        channels: of the sums of gradients in memory: 4 where one instruction adds as many, or 3.
    """

    transports: tuple[LightTransport, ...]
    addresses: Int[Tensor, "views 6"]
    half: bool
    channels: int

    @classmethod
    def of(cls, transports: tuple[LightTransport, ...]) -> KernelProduct:
        half = all(t.weight.dtype == torch.float16 for t in transports)
        kept = transports if half else tuple(replace(t, weight=t.weight.float()) for t in transports)
        first = accumulate((t.texels for t in kept), initial=0)
        rows = [
            [*(tensor.data_ptr() for tensor in (t.start, t.texel, t.weight, t.scale, t.background)), texel]
            for t, texel in zip(kept, first, strict=False)
        ]
        device = kept[0].texel.device
        return cls(kept, copy_async(torch.tensor(rows), device), half, 4 if _adds_vectors(device) else 3)

    def picture(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        return self._shown(texels, BACKGROUND=True)

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        return self._shown(texels, BACKGROUND=False)

    def _shown(self, texels: Float[Tensor, "texels 3"], **constants: bool) -> Float[Tensor, "pixels 3"]:
        image = texels.new_empty(len(self.transports) * self._pixels, 3)
        self._launch(picture, PICTURE["ROWS"], texels, image, **constants, **PICTURE)
        return image

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        """T^T @ grad. Not contiguous if there are four channels."""
        texels = grad.new_zeros(sum(t.texels for t in self.transports), self.channels)
        self._launch(transposed, 1 << TRANSPOSED["HALVINGS"], grad, texels, CHANNELS=self.channels, **TRANSPOSED)
        return texels[:, :3]

    @property
    def _pixels(self) -> int:
        return len(self.transports[0].start) - 1

    def _launch(self, kernel: Any, rows: int, source: Tensor, target: Tensor, **constants: int) -> None:
        grid = (triton.cdiv(self._pixels, rows), len(self.transports))
        with torch.cuda.device_of(source):
            kernel[grid](self.addresses, source, target, self._pixels, HALF=self.half, **constants)


def _adds_vectors(device: torch.device) -> bool:
    """NVIDIA's since sm_90. ROCm's devices have capabilities too, which mean others."""
    nvidia = device.type == "cuda" and torch.version.cuda is not None
    return nvidia and torch.cuda.get_device_capability(device) >= (9, 0)
