"""`norm_act_pad` by Triton kernels, and its derivative.

The forward pass reads `x` twice: for its moments, and to write the padded result. The backward pass reads the gradient
and `x` twice: for the two sums per channel that are the gradients of shift and scale and that the norm's gradient
needs, and to write the gradient of `x`. Where upsampling made the gradient larger than `x`, or a residual needs it too,
the first of these passes stores it at the size of `x` for the second.
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
from svbrdfgan.networks.fused.reference import Affine, Features, NormActPad
from svbrdfgan.networks.layers import EPSILON


@dataclass(frozen=True)
class Tile:
    """The work of one Triton program: `values` values at most, by `warps` warps."""

    values: int
    warps: int

    def shape(self, channels: int) -> tuple[int, int]:
        """Texels and channels of the tile, both powers of two."""
        cols = min(triton.next_power_of_2(channels), MOST_CHANNELS)
        return min(self.values // cols, MOST_TEXELS), cols


# `benchmarks/fused_norm.py` measures these sizes.
MOST_CHANNELS = 128  # of bf16 these are 256 bytes in one piece, which a warp reads at once
MOST_TEXELS = 128  # several hundred texels in one program spill registers
# The statistics read one tensor and hold less at a time than the others, which read up to three.
STATISTICS = Tile(8192, 8)
FORWARD = Tile(4096, 4)
BACKWARD_SUMS = Tile(4096, 4)
BACKWARD = Tile(4096, 4)
# Adds up a few hundred partial results per sample; few channels per program give more programs.
MOMENTS = {"TILES": 64, "CHANNELS": 16, "num_warps": 4}


def norm_act_pad_triton(
    x: Float[Tensor, "batch channels rows cols"],
    spec: NormActPad,
    residual: Float[Tensor, "batch channels rows cols"] | None = None,
    affine: Affine | None = None,
) -> Features:
    """The result of `norm_act_pad_reference`, in autocast's precision where that is on; differentiable once."""
    kind = x.device.type
    dtype = torch.get_autocast_dtype(kind) if torch.is_autocast_enabled(kind) else x.dtype
    return Features(*_NormActPad.apply(x, residual, affine, spec, dtype))


class _NormActPad(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, x: Tensor, residual: Tensor | None, affine: Affine | None, spec: NormActPad, dtype: torch.dtype
    ) -> tuple[Tensor, Tensor]:
        x = _channels_last(x)
        moments = _moments(x) if spec.norm else x  # kernels take some pointer, and do not read it without the norm
        if affine is not None:
            affine = affine.float().contiguous()
        ctx.save_for_backward(x, moments, affine)
        ctx.spec, ctx.has_residual = spec, residual is not None
        ctx.set_materialize_grads(False)  # usually one of the two results has no gradient: no zeros are made for it
        padded = _forward(x, moments, affine, residual, spec, dtype)
        rows, cols = (slice(spec.pad, size - spec.pad, spec.upsample) for size in padded.shape[-2:])
        return padded, padded[..., rows, cols]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad_padded: Tensor | None, grad_features: Tensor | None) -> tuple[Tensor | None, ...]:
        x, moments, affine = ctx.saved_tensors
        if grad_padded is None:
            assert grad_features is not None
            grad_padded = grad_features.new_zeros(_padded_shape(x, ctx.spec))
        grad_padded = _channels_last(grad_padded)
        return *_backward(grad_padded, grad_features, x, moments, affine, ctx.spec, ctx.has_residual), None, None


def _moments(x: Tensor) -> Float[Tensor, "batch 2 channels"]:
    """Mean and reciprocal standard deviation."""
    texels, channels = x.shape[2] * x.shape[3], x.shape[1]
    partials, moments = _partials(x, STATISTICS), x.new_empty((len(x), 2, channels), dtype=torch.float32)
    _launch(kernels.statistics, STATISTICS, x, texels, x, partials, texels, channels)
    grid = (len(x), triton.cdiv(channels, MOMENTS["CHANNELS"]))
    with torch.cuda.device_of(x):
        tile_texels = STATISTICS.shape(channels)[0]
        kernels.moments[grid](partials, moments, partials.shape[1], texels, channels, EPSILON, tile_texels, **MOMENTS)
    return moments


def _forward(
    x: Tensor, moments: Tensor, affine: Affine | None, residual: Tensor | None, spec: NormActPad, dtype: torch.dtype
) -> Tensor:
    shape, (_, channels, rows, cols) = _padded_shape(x, spec), x.shape
    padded = torch.empty(shape, dtype=dtype, device=x.device, memory_format=torch.channels_last)
    # a residual is often a view into a padded tensor: its rows may lie apart, its channels may not
    added = x if residual is None else residual if residual.stride(1) == 1 else _channels_last(residual)
    sample, _, row, col = added.stride()
    arguments = (x, moments, x if affine is None else affine, added, padded, rows, cols, channels, sample, row, col)
    flags = {"RESIDUAL": residual is not None, "AFFINE": affine is not None, **_flags(spec)}
    _launch(kernels.forward, FORWARD, x, shape[2] * shape[3], *arguments, **flags)
    return padded


def _backward(
    grad: Tensor,
    grad_features: Tensor | None,
    x: Tensor,
    moments: Tensor,
    affine: Affine | None,
    spec: NormActPad,
    has_residual: bool,
) -> tuple[Tensor, Tensor | None, Affine | None]:
    """The gradients of x and, if there are any, of the residual and the affine parameters."""
    _, channels, rows, cols = x.shape
    grad_x = torch.empty_like(x)
    grad_sum = torch.empty_like(x, dtype=grad.dtype) if has_residual else grad_x  # the residual's gradient is the sum's
    summed = spec.norm or affine is not None
    stored = has_residual or (summed and spec.upsample > 1)
    features = grad if grad_features is None else _channels_last(grad_features)
    tensors = (grad, features, x, moments, x if affine is None else affine, grad_sum)
    sizes = (rows, cols, channels)
    flags = {"GRAD_FEATURES": grad_features is not None, "AFFINE": affine is not None, **_flags(spec)}
    sums = moments
    if stored or summed:
        partials = _partials(x, BACKWARD_SUMS)
        _launch(kernels.backward_sums, BACKWARD_SUMS, x, rows * cols, *tensors, partials, *sizes, STORE=stored, **flags)
        sums = partials.sum(dim=1)
    _launch(kernels.backward, BACKWARD, x, rows * cols, *tensors, sums, grad_x, *sizes, STORED=stored, **flags)
    grad_affine = None if affine is None else sums.flip(1)  # the sums are those of the shift, then of the scale
    return grad_x, grad_sum if has_residual else None, grad_affine


def _launch(kernel: Any, tile: Tile, x: Tensor, texels: int, *arguments: Any, **flags: int) -> None:
    """Runs a kernel over this number of texels of each sample of x, and all its channels."""
    rows, cols = tile.shape(x.shape[1])
    grid = (triton.cdiv(texels, rows), len(x), triton.cdiv(x.shape[1], cols))
    with torch.cuda.device_of(x):
        kernel[grid](*arguments, **flags, TEXELS=rows, CHANNELS=cols, num_warps=tile.warps)


def _partials(x: Tensor, tile: Tile) -> Float[Tensor, "batch tiles 2 channels"]:
    """Memory for two numbers of each program and channel."""
    tiles = triton.cdiv(x.shape[2] * x.shape[3], tile.shape(x.shape[1])[0])
    return x.new_empty((len(x), tiles, 2, x.shape[1]), dtype=torch.float32)


def _flags(spec: NormActPad) -> dict[str, int]:
    return {"NORM": spec.norm, "RELU": spec.relu, "UPSAMPLE": spec.upsample, "PAD": spec.pad}


def _padded_shape(x: Tensor, spec: NormActPad) -> tuple[int, int, int, int]:
    rows, cols = (size * spec.upsample + 2 * spec.pad for size in x.shape[-2:])
    return *x.shape[:2], rows, cols


def _channels_last(x: Tensor) -> Tensor:
    return x.contiguous(memory_format=torch.channels_last)
