"""The product of stored transports on CUDA, by Triton kernels that read the entries of every view in place.

To make a batch, only addresses are copied. The kernels are bound by memory: an entry has 10 bytes with half-precision
weights.
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

# docs/lab/performance.md has both times on an H200. One warp takes 8 pixels, and 16 entries of each at a time: a
# tile runs until its pixel with most entries is done, so that more pixels would mean more idle lanes.
PICTURE = {"ROWS": 8, "LANES": 16, "num_warps": 1}
# A program takes the entries of 2^HALVINGS pixels, 256 at a time, whichever pixel they belong to.
TRANSPOSED = {"HALVINGS": 4, "ENTRIES": 256, "num_warps": 2}


@triton.jit
def view_of(views, HALF: tl.constexpr):
    """The addresses of the tensors of the program's view, its scale and its first texel."""
    view = views + tl.program_id(1) * 6
    start = tl.load(view).to(tl.pointer_type(tl.int32))
    texel = tl.load(view + 1).to(tl.pointer_type(tl.int32))
    weight = tl.load(view + 2).to(tl.pointer_type(tl.float16 if HALF else tl.float32))
    scale = tl.load(tl.load(view + 3).to(tl.pointer_type(tl.float32)))
    background = tl.load(view + 4).to(tl.pointer_type(tl.float32))
    return start, texel, weight, scale, background, tl.load(view + 5)


@triton.jit
def load_color(address, mask):
    """The three consecutive numbers at each address, as float32."""
    red = tl.load(address, mask=mask, other=0).to(tl.float32)
    green = tl.load(address + 1, mask=mask, other=0).to(tl.float32)
    return red, green, tl.load(address + 2, mask=mask, other=0).to(tl.float32)


@triton.jit
def picture(
    views, textures, image, pixels,
    HALF: tl.constexpr, BACKGROUND: tl.constexpr, ROWS: tl.constexpr, LANES: tl.constexpr,
):  # fmt: skip
    """image = T @ textures, plus the background if BACKGROUND."""
    start, texel, weight, scale, background, offset = view_of(views, HALF)
    pixel = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
    inside = pixel < pixels
    first = tl.load(start + pixel, mask=inside, other=0)
    last = tl.load(start + pixel + 1, mask=inside, other=0)
    behind_red = tl.zeros([ROWS], tl.float32)
    behind_green = tl.zeros([ROWS], tl.float32)
    behind_blue = tl.zeros([ROWS], tl.float32)
    if BACKGROUND:
        behind_red, behind_green, behind_blue = load_color(background + pixel * 3, inside)
    textures += offset * 3
    red = tl.zeros([ROWS, LANES], tl.float32)
    green = tl.zeros([ROWS, LANES], tl.float32)
    blue = tl.zeros([ROWS, LANES], tl.float32)
    for done in range(0, tl.max(last - first, axis=0), LANES):
        entry = first[:, None] + done + tl.arange(0, LANES)[None, :]
        mask = entry < last[:, None]
        index = tl.load(texel + entry, mask=mask, other=0).to(tl.int64)
        weight_red, weight_green, weight_blue = load_color(weight + entry.to(tl.int64) * 3, mask)
        color_red, color_green, color_blue = load_color(textures + index * 3, mask)
        red += weight_red * color_red
        green += weight_green * color_green
        blue += weight_blue * color_blue
    result = image + (tl.program_id(1).to(tl.int64) * pixels + pixel) * 3
    tl.store(result, behind_red + scale * tl.sum(red, axis=1), mask=inside)
    tl.store(result + 1, behind_green + scale * tl.sum(green, axis=1), mask=inside)
    tl.store(result + 2, behind_blue + scale * tl.sum(blue, axis=1), mask=inside)


@triton.jit
def row_of(entry, start, rows, HALVINGS: tl.constexpr):
    """The row of each entry: the last of 2^HALVINGS that starts at or before it. Only the first `rows` exist."""
    row = tl.zeros_like(entry)
    for halving in tl.static_range(HALVINGS):
        middle = row + (1 << (HALVINGS - 1 - halving))
        first = tl.load(start + middle, mask=middle < rows, other=2147483647)
        row = tl.where(first <= entry, middle, row)
    return row


@triton.jit
def add_color(address, red, green, blue, mask, CHANNELS: tl.constexpr):
    """Adds a colour at each address atomically."""
    if CHANNELS == 4:
        # padded with a zero to 16 aligned bytes, which sm_90 adds by one instruction
        pairs = tl.join(tl.join(red, blue), tl.join(green, tl.zeros_like(red)))
        channel = address[:, None] + tl.arange(0, 4)[None, :]
        tl.atomic_add(channel, pairs.reshape(red.shape[0], 4), mask=mask[:, None], sem="relaxed")
    else:
        tl.atomic_add(address, red, mask=mask, sem="relaxed")
        tl.atomic_add(address + 1, green, mask=mask, sem="relaxed")
        tl.atomic_add(address + 2, blue, mask=mask, sem="relaxed")


@triton.jit
def transposed(
    views, grad_image, grad_textures, pixels,
    HALF: tl.constexpr, CHANNELS: tl.constexpr, HALVINGS: tl.constexpr, ENTRIES: tl.constexpr,
):  # fmt: skip
    """grad_textures += T^T @ grad_image."""
    # entries are taken in the order of memory, across rows, so that short rows leave no lane idle
    start, texel, weight, scale, _, offset = view_of(views, HALF)
    pixel = tl.program_id(0) << HALVINGS
    first = tl.load(start + pixel)
    last = tl.load(start + tl.minimum(pixel + (1 << HALVINGS), pixels))
    grad = grad_image + (tl.program_id(1).to(tl.int64) * pixels + pixel) * 3
    grad_textures += offset * CHANNELS
    for done in range(first, last, ENTRIES):
        entry = done + tl.arange(0, ENTRIES)
        mask = entry < last
        index = tl.load(texel + entry, mask=mask, other=0).to(tl.int64)
        weight_red, weight_green, weight_blue = load_color(weight + entry.to(tl.int64) * 3, mask)
        row = row_of(entry, start + pixel, pixels - pixel, HALVINGS)
        red, green, blue = load_color(grad + row * 3, mask)
        red, green, blue = scale * weight_red * red, scale * weight_green * green, scale * weight_blue * blue
        add_color(grad_textures + index * CHANNELS, red, green, blue, mask, CHANNELS)


@dataclass(frozen=True, eq=False)
class TritonProduct:
    """The kernels over a batch.

    Attributes:
        transports: kept so that the memory behind the addresses stays theirs.
        addresses: for each transport those of start, texel, weight, scale and background, and its first texel.
        half: whether weights are in half precision; else they are in single precision.
        channels: of the gradient's sums in memory: 4 where one instruction adds four numbers, else 3.
    """

    transports: tuple[LightTransport, ...]
    addresses: Int[Tensor, "views 6"]
    half: bool
    channels: int

    @classmethod
    def of(cls, transports: tuple[LightTransport, ...]) -> TritonProduct:
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
        return self._picture(texels, BACKGROUND=True)

    def linear(self, texels: Float[Tensor, "texels 3"]) -> Float[Tensor, "pixels 3"]:
        return self._picture(texels, BACKGROUND=False)

    def _picture(self, texels: Float[Tensor, "texels 3"], **constants: bool) -> Float[Tensor, "pixels 3"]:
        image = texels.new_empty(len(self.transports) * self._pixels, 3)
        self._launch(picture, PICTURE["ROWS"], texels, image, **constants, **PICTURE)
        return image

    def transposed(self, grad: Float[Tensor, "pixels 3"]) -> Float[Tensor, "texels 3"]:
        """T^T @ grad; not contiguous if there are four channels."""
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
    """Whether the device adds four floats by one atomic instruction: NVIDIA's do since sm_90."""
    nvidia = device.type == "cuda" and torch.version.cuda is not None  # ROCm's numbers mean other instructions
    return nvidia and torch.cuda.get_device_capability(device) >= (9, 0)
