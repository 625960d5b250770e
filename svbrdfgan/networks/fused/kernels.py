"""Triton kernels of a prologue, over channels-last memory.

A program takes TEXELS texels of one sample and CHANNELS of their channels, which lie side by side. Sums over texels are
taken in a fixed order: each program writes its own share, and the shares are added afterwards.
"""
# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: N803

from __future__ import annotations

import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
import triton.language as tl  # type: ignore[import-not-found, import-untyped, unused-ignore]


@triton.jit
def tile(texels, channels, TEXELS: tl.constexpr, CHANNELS: tl.constexpr):
    """The program's sample, texels and channels, and which of them there are."""
    texel = tl.program_id(0) * TEXELS + tl.arange(0, TEXELS)
    channel = tl.program_id(2) * CHANNELS + tl.arange(0, CHANNELS)
    there = (texel < texels)[:, None] & (channel < channels)[None, :]
    return tl.program_id(1).to(tl.int64), texel, channel, there


@triton.jit
def share(sample, channels, channel):
    """Where the first of the two numbers lies that the program gives for each channel; the second is `channels` on."""
    return (sample * tl.num_programs(0) + tl.program_id(0)) * 2 * channels + channel


@triton.jit
def statistics(x, shares, texels, channels, TEXELS: tl.constexpr, CHANNELS: tl.constexpr):
    """Each tile's mean, and its sum of squared differences from that."""
    sample, texel, channel, there = tile(texels, channels, TEXELS, CHANNELS)
    x += sample * texels * channels
    values = tl.load(x + texel[:, None] * channels + channel[None, :], mask=there, other=0).to(tl.float32)
    mean = tl.sum(values, axis=0) / tl.minimum(texels - tl.program_id(0) * TEXELS, TEXELS)
    difference = tl.where(there, values - mean[None, :], 0)
    at = share(sample, channels, channel)
    tl.store(shares + at, mean, mask=channel < channels)
    tl.store(shares + at + channels, tl.sum(difference * difference, axis=0), mask=channel < channels)


@triton.jit
def moments(
    shares, found, tiles, texels, channels, epsilon, TEXELS: tl.constexpr, TILES: tl.constexpr, CHANNELS: tl.constexpr
):
    """Mean and reciprocal standard deviation of whole samples (Chan et al. 1979)."""
    sample = tl.program_id(0)
    channel = tl.program_id(1) * CHANNELS + tl.arange(0, CHANNELS)
    total = tl.zeros([CHANNELS], tl.float32)
    for start in range(0, tiles, TILES):
        number = start + tl.arange(0, TILES)
        there = (number < tiles)[:, None] & (channel < channels)[None, :]
        count = tl.minimum(texels - number * TEXELS, TEXELS).to(tl.float32)[:, None]
        place = (sample * tiles + number)[:, None] * 2 * channels + channel[None, :]
        total += tl.sum(count * tl.load(shares + place, mask=there, other=0), axis=0)
    mean = total / texels
    squares = tl.zeros([CHANNELS], tl.float32)
    for start in range(0, tiles, TILES):
        number = start + tl.arange(0, TILES)
        there = (number < tiles)[:, None] & (channel < channels)[None, :]
        count = tl.minimum(texels - number * TEXELS, TEXELS).to(tl.float32)[:, None]
        place = (sample * tiles + number)[:, None] * 2 * channels + channel[None, :]
        off = tl.load(shares + place, mask=there, other=0) - mean[None, :]
        within = tl.load(shares + place + channels, mask=there, other=0)
        squares += tl.sum(tl.where(there, within + count * off * off, 0), axis=0)
    at = sample * 2 * channels + channel
    tl.store(found + at, mean, mask=channel < channels)
    tl.store(found + at + channels, 1 / tl.sqrt(squares / texels + epsilon), mask=channel < channels)


@triton.jit
def normalised(values, found, sample, channel, channels, NORM: tl.constexpr):
    """The values less their mean over their standard deviation, and the reciprocal of that."""
    scale = tl.full([1, 1], 1, tl.float32)
    if NORM:
        at = found + sample * 2 * channels + channel
        mean = tl.load(at, mask=channel < channels, other=0)[None, :]
        scale = tl.load(at + channels, mask=channel < channels, other=0)[None, :]
        values = (values - mean) * scale
    return values, scale


@triton.jit
def reflected(index, size):
    index = tl.abs(index)
    return tl.minimum(index, 2 * (size - 1) - index)


@triton.jit
def forward(
    x, found, residual, padded, rows, cols, channels, sample_stride, row_stride, col_stride,
    NORM: tl.constexpr, RELU: tl.constexpr, RESIDUAL: tl.constexpr, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
    TEXELS: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """padded = reflect_pad(upsample(relu(norm(x)) + residual)). The strides are those of the residual."""
    wide = cols * UPSAMPLE + 2 * PAD
    texels = (rows * UPSAMPLE + 2 * PAD) * wide
    sample, texel, channel, there = tile(texels, channels, TEXELS, CHANNELS)
    row = reflected(texel // wide - PAD, rows * UPSAMPLE) // UPSAMPLE
    col = reflected(texel % wide - PAD, cols * UPSAMPLE) // UPSAMPLE
    x += sample * rows * cols * channels
    place = ((row * cols + col) * channels)[:, None] + channel[None, :]
    values = tl.load(x + place, mask=there, other=0).to(tl.float32)
    values, _ = normalised(values, found, sample, channel, channels, NORM)
    if RELU:
        values = tl.where(values < 0, 0, values)  # which keeps what is not a number
    if RESIDUAL:
        residual += sample * sample_stride
        place = (row * row_stride + col * col_stride)[:, None] + channel[None, :]
        values += tl.load(residual + place, mask=there, other=0).to(tl.float32)
    padded += sample * texels * channels
    place = texel[:, None] * channels + channel[None, :]
    tl.store(padded + place, values.to(padded.dtype.element_ty), mask=there)


@triton.jit
def mirrored(index, size, PAD: tl.constexpr):
    """Which padded index repeats this one by reflection, or -1."""
    after = tl.where((index >= size - 1 - PAD) & (index <= size - 2), PAD + 2 * (size - 1) - index, -1)
    return tl.where((index >= 1) & (index <= PAD), PAD - index, after)


@triton.jit
def row_gradient(
    grad, row, col, cols, channels, channel, there, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
):  # fmt: skip
    """The sum over the padded texels of given rows that repeat given columns."""
    start = grad + row[:, None] * (cols * UPSAMPLE + 2 * PAD) * channels + channel[None, :]
    total = tl.load(start + (col * UPSAMPLE + PAD)[:, None] * channels, mask=there, other=0).to(tl.float32)
    for repeat in tl.static_range(1, UPSAMPLE):
        at = (col * UPSAMPLE + PAD + repeat)[:, None] * channels
        total += tl.load(start + at, mask=there, other=0).to(tl.float32)
    if PAD > 0:
        for repeat in tl.static_range(UPSAMPLE):
            mirror = mirrored(col * UPSAMPLE + repeat, cols * UPSAMPLE, PAD)
            reflects = there & (mirror >= 0)[:, None]
            total += tl.load(start + mirror[:, None] * channels, mask=reflects, other=0).to(tl.float32)
    return total


@triton.jit
def unpadded_gradient(
    grad, carry, sample, texel, channel, there, rows, cols, channels,
    CARRY: tl.constexpr, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
):  # fmt: skip
    """The sum over all that repeat a texel, of which there are few but in the rows next to the border."""
    row, col = texel // cols, texel % cols
    high, wide = rows * UPSAMPLE, cols * UPSAMPLE
    grad += sample * (high + 2 * PAD) * (wide + 2 * PAD) * channels
    total = row_gradient(grad, row * UPSAMPLE + PAD, col, cols, channels, channel, there, UPSAMPLE, PAD)
    for repeat in tl.static_range(1, UPSAMPLE):
        at = row * UPSAMPLE + PAD + repeat
        total += row_gradient(grad, at, col, cols, channels, channel, there, UPSAMPLE, PAD)
    if PAD > 0:
        start = tl.program_id(0) * texel.shape[0]
        first, after = start // cols * UPSAMPLE, ((start + texel.shape[0] - 1) // cols + 1) * UPSAMPLE
        if (first <= PAD) | (after >= high - PAD):
            for repeat in tl.static_range(UPSAMPLE):
                mirror = mirrored(row * UPSAMPLE + repeat, high, PAD)
                reflects = there & (mirror >= 0)[:, None]
                total += row_gradient(grad, mirror, col, cols, channels, channel, reflects, UPSAMPLE, PAD)
    if CARRY:
        carry += sample * rows * cols * channels
        place = texel[:, None] * channels + channel[None, :]
        total += tl.load(carry + place, mask=there, other=0).to(tl.float32)
    return total


@triton.jit
def backward_sums(
    grad, carry, x, found, unpadded, shares, rows, cols, channels,
    CARRY: tl.constexpr, NORM: tl.constexpr, RELU: tl.constexpr, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
    KEEP: tl.constexpr, TEXELS: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """Keeps the gradient of the unpadded sum, and each tile's share of what the norm's gradient needs."""
    sample, texel, channel, there = tile(rows * cols, channels, TEXELS, CHANNELS)
    start = sample * rows * cols * channels
    place = texel[:, None] * channels + channel[None, :]
    slope = unpadded_gradient(grad, carry, sample, texel, channel, there, rows, cols, channels, CARRY, UPSAMPLE, PAD)
    if KEEP:
        tl.store(unpadded + start + place, slope.to(unpadded.dtype.element_ty), mask=there)
    if NORM:
        values = tl.load(x + start + place, mask=there, other=0).to(tl.float32)
        values, _ = normalised(values, found, sample, channel, channels, NORM)
        if RELU:
            slope = tl.where(values <= 0, 0, slope)
        at = share(sample, channels, channel)
        tl.store(shares + at, tl.sum(slope, axis=0), mask=channel < channels)
        tl.store(shares + at + channels, tl.sum(slope * values, axis=0), mask=channel < channels)


@triton.jit
def backward(
    grad, carry, x, found, unpadded, sums, grad_x, rows, cols, channels,
    CARRY: tl.constexpr, NORM: tl.constexpr, RELU: tl.constexpr, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
    KEPT: tl.constexpr, TEXELS: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """grad_x, of the gradient that was kept or is gathered again. The two may share memory."""
    sample, texel, channel, there = tile(rows * cols, channels, TEXELS, CHANNELS)
    start = sample * rows * cols * channels
    place = texel[:, None] * channels + channel[None, :]
    if KEPT:
        slope = tl.load(unpadded + start + place, mask=there, other=0).to(tl.float32)
    else:
        slope = unpadded_gradient(
            grad, carry, sample, texel, channel, there, rows, cols, channels, CARRY, UPSAMPLE, PAD
        )
    if NORM or RELU:
        values = tl.load(x + start + place, mask=there, other=0).to(tl.float32)
        values, scale = normalised(values, found, sample, channel, channels, NORM)
        if RELU:
            slope = tl.where(values <= 0, 0, slope)
        if NORM:
            at = sums + sample * 2 * channels + channel
            mean = tl.load(at, mask=channel < channels, other=0)[None, :] / (rows * cols)
            along = tl.load(at + channels, mask=channel < channels, other=0)[None, :] / (rows * cols)
            slope = (slope - mean - values * along) * scale
    tl.store(grad_x + start + place, slope.to(grad_x.dtype.element_ty), mask=there)
