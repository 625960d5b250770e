"""A prologue by Triton kernels, and its derivative.

Forward, `x` is read for its moments, and read again while the padded result is written. Backward, the gradient and `x`
are read for two sums per channel, and read again while the gradient of `x` is written. Where upsampling made the
gradient larger than `x`, or a residual wants it, the first of these passes keeps it at the size of `x` for the second.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from svbrdfgan.networks.fused import kernels
from svbrdfgan.networks.fused.reference import Features, Prologue
from svbrdfgan.networks.norm import EPSILON


@dataclass(frozen=True)
class Tile:
    """What a program takes: at most so many values at once, by so many warps."""

    values: int
    warps: int

    def block(self, channels: int) -> tuple[int, int]:
        """Its texels and channels, both powers of two."""
        beside = min(triton.next_power_of_2(channels), MOST_CHANNELS)
        return min(self.values // beside, MOST_TEXELS), beside


MOST_CHANNELS, MOST_TEXELS = 128, 128  # of a program; several hundred texels spill registers
STATISTICS = Tile(8192, 8)
FORWARD = Tile(4096, 4)
BACKWARD_SUMS = Tile(4096, 4)
BACKWARD = Tile(4096, 4)
MOMENTS = {"TILES": 64, "CHANNELS": 16, "num_warps": 4}


def fused(
    x: Float[Tensor, "batch channels rows cols"],
    how: Prologue,
    residual: Float[Tensor, "batch channels rows cols"] | None = None,
) -> Features:
    """The same as `plain`, in autocast's precision where that is on."""
    kind = x.device.type
    dtype = torch.get_autocast_dtype(kind) if torch.is_autocast_enabled(kind) else x.dtype
    return Features(*_Fused.apply(x, residual, how, dtype))


class _Fused(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, residual: Tensor | None, how: Prologue, dtype: torch.dtype) -> tuple[Tensor, ...]:
        x = _channels_last(x)
        found = _moments(x) if how.norm else x
        ctx.save_for_backward(x, found)
        ctx.how, ctx.added = how, residual is not None
        ctx.set_materialize_grads(False)
        padded = _forward(x, found, residual, how, dtype)
        rows, cols = (slice(how.pad, size - how.pad, how.upsample) for size in padded.shape[-2:])
        return padded, padded[..., rows, cols]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor | None, carry: Tensor | None) -> tuple[Tensor | None, ...]:
        x, found = ctx.saved_tensors
        if grad is None:
            assert carry is not None
            grad = carry.new_zeros(_padded_shape(x, ctx.how))
        return *_backward(_channels_last(grad), carry, x, found, ctx.how, ctx.added), None, None


def _moments(x: Tensor) -> Float[Tensor, "batch 2 channels"]:
    """Mean and reciprocal standard deviation."""
    texels, channels = x.shape[2] * x.shape[3], x.shape[1]
    shares, found = _shares(x, STATISTICS), x.new_empty((len(x), 2, channels), dtype=torch.float32)
    _launch(kernels.statistics, STATISTICS, x, texels, x, shares, texels, channels)
    grid = (len(x), triton.cdiv(channels, MOMENTS["CHANNELS"]))
    with torch.cuda.device_of(x):
        height = STATISTICS.block(channels)[0]
        kernels.moments[grid](shares, found, shares.shape[1], texels, channels, EPSILON, height, **MOMENTS)
    return found


def _forward(x: Tensor, found: Tensor, residual: Tensor | None, how: Prologue, dtype: torch.dtype) -> Tensor:
    shape, (_, channels, rows, cols) = _padded_shape(x, how), x.shape
    padded = torch.empty(shape, dtype=dtype, device=x.device, memory_format=torch.channels_last)
    added = x if residual is None else residual if residual.stride(1) == 1 else _channels_last(residual)
    sample, _, row, col = added.stride()
    arguments = (x, found, added, padded, rows, cols, channels, sample, row, col)
    flags = {"RESIDUAL": residual is not None, **_flags(how)}
    _launch(kernels.forward, FORWARD, x, shape[2] * shape[3], *arguments, **flags)
    return padded


def _backward(
    grad: Tensor, carry: Tensor | None, x: Tensor, found: Tensor, how: Prologue, added: bool
) -> tuple[Tensor, Tensor | None]:
    """The gradients of x and, if one was added, of the residual."""
    _, channels, rows, cols = x.shape
    grad_x = torch.empty_like(x)
    unpadded = torch.empty_like(x, dtype=grad.dtype) if added else grad_x
    kept = added or (how.norm and how.upsample > 1)
    given = (grad, grad if carry is None else _channels_last(carry), x, found, unpadded)
    sizes = (rows, cols, channels)
    flags = {"CARRY": carry is not None, **_flags(how)}
    sums = found
    if kept or how.norm:
        shares = _shares(x, BACKWARD_SUMS)
        _launch(kernels.backward_sums, BACKWARD_SUMS, x, rows * cols, *given, shares, *sizes, KEEP=kept, **flags)
        sums = shares.sum(dim=1)
    _launch(kernels.backward, BACKWARD, x, rows * cols, *given, sums, grad_x, *sizes, KEPT=kept, **flags)
    return grad_x, unpadded if added else None


def _launch(kernel: Any, tile: Tile, x: Tensor, texels: int, *arguments: Any, **flags: int) -> None:
    """Runs a kernel over so many texels of each sample of x, and all its channels."""
    high, wide = tile.block(x.shape[1])
    grid = (triton.cdiv(texels, high), len(x), triton.cdiv(x.shape[1], wide))
    with torch.cuda.device_of(x):
        kernel[grid](*arguments, **flags, TEXELS=high, CHANNELS=wide, num_warps=tile.warps)


def _shares(x: Tensor, tile: Tile) -> Float[Tensor, "batch tiles 2 channels"]:
    """Room for two numbers of each program and channel."""
    tiles = triton.cdiv(x.shape[2] * x.shape[3], tile.block(x.shape[1])[0])
    return x.new_empty((len(x), tiles, 2, x.shape[1]), dtype=torch.float32)


def _flags(how: Prologue) -> dict[str, int]:
    return {"NORM": how.norm, "RELU": how.relu, "UPSAMPLE": how.upsample, "PAD": how.pad}


def _padded_shape(x: Tensor, how: Prologue) -> tuple[int, int, int, int]:
    rows, cols = (size * how.upsample + 2 * how.pad for size in x.shape[-2:])
    return *x.shape[:2], rows, cols


def _channels_last(x: Tensor) -> Tensor:
    return x.contiguous(memory_format=torch.channels_last)
