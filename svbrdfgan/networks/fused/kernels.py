"""The Triton kernels of `norm_act_pad`, over channels-last memory.

A program takes a tile: TEXELS texels of one sample and CHANNELS of their channels, which lie side by side in memory.
Sums over texels have a fixed order, so that results repeat bit for bit: each program writes a partial sum, and these
are added afterwards.
"""
# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: N803

from __future__ import annotations

import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
import triton.language as tl  # type: ignore[import-not-found, import-untyped, unused-ignore]


@triton.jit
def tile_indices(texels, channels, TEXELS: tl.constexpr, CHANNELS: tl.constexpr):
    """The program's sample, texels and channels, and the mask of those that exist."""
    texel = tl.program_id(0) * TEXELS + tl.arange(0, TEXELS)
    channel = tl.program_id(2) * CHANNELS + tl.arange(0, CHANNELS)
    mask = (texel < texels)[:, None] & (channel < channels)[None, :]
    return tl.program_id(1).to(tl.int64), texel, channel, mask  # int64, since offsets in a large batch exceed 2^31


@triton.jit
def partial_offset(sample, channels, channel):
    """Offset of the first of the program's two numbers for each channel; the second lies `channels` further on."""
    return (sample * tl.num_programs(0) + tl.program_id(0)) * 2 * channels + channel


@triton.jit
def statistics(x, partials, texels, channels, TEXELS: tl.constexpr, CHANNELS: tl.constexpr):
    """Stores each tile's mean, and its sum of squared differences from that mean."""
    # not sums of squares, which cancel: with a mean of 1,000 they lose most digits of a variance of 1
    sample, texel, channel, mask = tile_indices(texels, channels, TEXELS, CHANNELS)
    x += sample * texels * channels
    values = tl.load(x + texel[:, None] * channels + channel[None, :], mask=mask, other=0).to(tl.float32)
    mean = tl.sum(values, axis=0) / tl.minimum(texels - tl.program_id(0) * TEXELS, TEXELS)
    difference = tl.where(mask, values - mean[None, :], 0)
    offset = partial_offset(sample, channels, channel)
    tl.store(partials + offset, mean, mask=channel < channels)
    tl.store(partials + offset + channels, tl.sum(difference * difference, axis=0), mask=channel < channels)


@triton.jit
def moments(
    partials, result, tiles, texels, channels, epsilon,
    TEXELS: tl.constexpr, TILES: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """Mean and reciprocal standard deviation of whole samples, from those of their tiles (Chan et al. 1979)."""
    sample = tl.program_id(0)
    channel = tl.program_id(1) * CHANNELS + tl.arange(0, CHANNELS)
    total = tl.zeros([CHANNELS], tl.float32)
    for start in range(0, tiles, TILES):
        tile = start + tl.arange(0, TILES)
        mask = (tile < tiles)[:, None] & (channel < channels)[None, :]
        count = tl.minimum(texels - tile * TEXELS, TEXELS).to(tl.float32)[:, None]
        offset = (sample * tiles + tile)[:, None] * 2 * channels + channel[None, :]
        total += tl.sum(count * tl.load(partials + offset, mask=mask, other=0), axis=0)
    mean = total / texels
    squares = tl.zeros([CHANNELS], tl.float32)
    for start in range(0, tiles, TILES):
        tile = start + tl.arange(0, TILES)
        mask = (tile < tiles)[:, None] & (channel < channels)[None, :]
        count = tl.minimum(texels - tile * TEXELS, TEXELS).to(tl.float32)[:, None]
        offset = (sample * tiles + tile)[:, None] * 2 * channels + channel[None, :]
        difference = tl.load(partials + offset, mask=mask, other=0) - mean[None, :]
        within = tl.load(partials + offset + channels, mask=mask, other=0)
        squares += tl.sum(tl.where(mask, within + count * difference * difference, 0), axis=0)
    offset = sample * 2 * channels + channel
    tl.store(result + offset, mean, mask=channel < channels)
    tl.store(result + offset + channels, 1 / tl.sqrt(squares / texels + epsilon), mask=channel < channels)


@triton.jit
def two_of_each_channel(numbers, sample, channel, channels):
    """Both numbers that a sample has for each channel: all first ones lie before all second ones."""
    offset = numbers + sample * 2 * channels + channel
    first = tl.load(offset, mask=channel < channels, other=0)
    return first[None, :], tl.load(offset + channels, mask=channel < channels, other=0)[None, :]


@triton.jit
def normalise(values, moments, sample, channel, channels, NORM: tl.constexpr):
    """The normalised values, and the reciprocal standard deviation."""
    scale = tl.full([1, 1], 1, tl.float32)
    if NORM:
        mean, scale = two_of_each_channel(moments, sample, channel, channels)
        values = (values - mean) * scale
    return values, scale


@triton.jit
def modulate(values, affine, sample, channel, channels, AFFINE: tl.constexpr):
    """The values times the scale plus the shift of their channel, and the scale."""
    scale = tl.full([1, 1], 1, tl.float32)
    if AFFINE:
        scale, shift = two_of_each_channel(affine, sample, channel, channels)
        values = values * scale + shift
    return values, scale


@triton.jit
def reflect(index, size):
    """The index inside that an index of the padding repeats."""
    index = tl.abs(index)
    return tl.minimum(index, 2 * (size - 1) - index)


@triton.jit
def forward(
    x, moments, affine, residual, padded, rows, cols, channels, sample_stride, row_stride, col_stride,
    NORM: tl.constexpr, AFFINE: tl.constexpr, RELU: tl.constexpr, RESIDUAL: tl.constexpr, UPSAMPLE: tl.constexpr,
    PAD: tl.constexpr, TEXELS: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """padded = reflect_pad(upsample(relu(affine(norm(x))) + residual)). The strides are those of the residual."""
    padded_cols = cols * UPSAMPLE + 2 * PAD
    texels = (rows * UPSAMPLE + 2 * PAD) * padded_cols
    sample, texel, channel, mask = tile_indices(texels, channels, TEXELS, CHANNELS)
    row = reflect(texel // padded_cols - PAD, rows * UPSAMPLE) // UPSAMPLE
    col = reflect(texel % padded_cols - PAD, cols * UPSAMPLE) // UPSAMPLE
    x += sample * rows * cols * channels
    offset = ((row * cols + col) * channels)[:, None] + channel[None, :]
    values = tl.load(x + offset, mask=mask, other=0).to(tl.float32)
    values, _ = normalise(values, moments, sample, channel, channels, NORM)
    values, _ = modulate(values, affine, sample, channel, channels, AFFINE)
    if RELU:
        values = tl.where(values < 0, 0, values)  # unlike a maximum, it keeps NaN
    if RESIDUAL:
        residual += sample * sample_stride
        offset = (row * row_stride + col * col_stride)[:, None] + channel[None, :]
        values += tl.load(residual + offset, mask=mask, other=0).to(tl.float32)
    padded += sample * texels * channels
    offset = texel[:, None] * channels + channel[None, :]
    tl.store(padded + offset, values.to(padded.dtype.element_ty), mask=mask)


@triton.jit
def mirror_index(index, size, PAD: tl.constexpr):
    """The padded index that repeats this one by reflection, or -1. There is one at most: see `_kernels_apply`."""
    after = tl.where((index >= size - 1 - PAD) & (index <= size - 2), PAD + 2 * (size - 1) - index, -1)
    return tl.where((index >= 1) & (index <= PAD), PAD - index, after)


@triton.jit
def row_gradient(
    grad, row, col, cols, channels, channel, mask, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
):  # fmt: skip
    """The sum over the texels of a padded row that repeat a column, for given padded rows and given columns."""
    start = grad + row[:, None] * (cols * UPSAMPLE + 2 * PAD) * channels + channel[None, :]
    total = tl.load(start + (col * UPSAMPLE + PAD)[:, None] * channels, mask=mask, other=0).to(tl.float32)
    for repeat in tl.static_range(1, UPSAMPLE):
        offset = (col * UPSAMPLE + PAD + repeat)[:, None] * channels
        total += tl.load(start + offset, mask=mask, other=0).to(tl.float32)
    if PAD > 0:
        for repeat in tl.static_range(UPSAMPLE):
            mirror = mirror_index(col * UPSAMPLE + repeat, cols * UPSAMPLE, PAD)
            reflects = mask & (mirror >= 0)[:, None]
            total += tl.load(start + mirror[:, None] * channels, mask=reflects, other=0).to(tl.float32)
    return total


@triton.jit
def sum_gradient(
    grad, grad_features, sample, texel, channel, mask, rows, cols, channels,
    GRAD_FEATURES: tl.constexpr, UPSAMPLE: tl.constexpr, PAD: tl.constexpr,
):  # fmt: skip
    """The gradient of relu(affine(norm(x))) + residual: the sum over all padded texels that repeat a texel."""
    row, col = texel // cols, texel % cols
    tall, wide = rows * UPSAMPLE, cols * UPSAMPLE
    grad += sample * (tall + 2 * PAD) * (wide + 2 * PAD) * channels
    total = row_gradient(grad, row * UPSAMPLE + PAD, col, cols, channels, channel, mask, UPSAMPLE, PAD)
    for repeat in tl.static_range(1, UPSAMPLE):
        offset = row * UPSAMPLE + PAD + repeat
        total += row_gradient(grad, offset, col, cols, channels, channel, mask, UPSAMPLE, PAD)
    if PAD > 0:
        # only programs with rows next to the border gather reflected rows; the others skip the loads
        start = tl.program_id(0) * texel.shape[0]
        first, after = start // cols * UPSAMPLE, ((start + texel.shape[0] - 1) // cols + 1) * UPSAMPLE
        if (first <= PAD) | (after >= tall - PAD):
            for repeat in tl.static_range(UPSAMPLE):
                mirror = mirror_index(row * UPSAMPLE + repeat, tall, PAD)
                reflects = mask & (mirror >= 0)[:, None]
                total += row_gradient(grad, mirror, col, cols, channels, channel, reflects, UPSAMPLE, PAD)
    if GRAD_FEATURES:
        grad_features += sample * rows * cols * channels
        offset = texel[:, None] * channels + channel[None, :]
        total += tl.load(grad_features + offset, mask=mask, other=0).to(tl.float32)
    return total


@triton.jit
def backward_sums(
    grad, grad_features, x, moments, affine, grad_sum, partials, rows, cols, channels,
    GRAD_FEATURES: tl.constexpr, NORM: tl.constexpr, AFFINE: tl.constexpr, RELU: tl.constexpr, UPSAMPLE: tl.constexpr,
    PAD: tl.constexpr, STORE: tl.constexpr, TEXELS: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """Stores the gradient of the sum with the residual, and each tile's partial sums for those of shift and scale.

    The norm's gradient needs these, too.
    """
    sample, texel, channel, mask = tile_indices(rows * cols, channels, TEXELS, CHANNELS)
    start = sample * rows * cols * channels
    offset = texel[:, None] * channels + channel[None, :]
    slope = sum_gradient(
        grad, grad_features, sample, texel, channel, mask, rows, cols, channels, GRAD_FEATURES, UPSAMPLE, PAD
    )
    if STORE:
        tl.store(grad_sum + start + offset, slope.to(grad_sum.dtype.element_ty), mask=mask)
    if NORM or AFFINE:
        values = tl.load(x + start + offset, mask=mask, other=0).to(tl.float32)
        values, _ = normalise(values, moments, sample, channel, channels, NORM)
        if RELU:
            active, _ = modulate(values, affine, sample, channel, channels, AFFINE)
            slope = tl.where(active <= 0, 0, slope)  # 0 at 0 too, as torch's
        partial = partial_offset(sample, channels, channel)
        tl.store(partials + partial, tl.sum(slope, axis=0), mask=channel < channels)
        tl.store(partials + partial + channels, tl.sum(slope * values, axis=0), mask=channel < channels)


@triton.jit
def backward(
    grad, grad_features, x, moments, affine, grad_sum, sums, grad_x, rows, cols, channels,
    GRAD_FEATURES: tl.constexpr, NORM: tl.constexpr, AFFINE: tl.constexpr, RELU: tl.constexpr, UPSAMPLE: tl.constexpr,
    PAD: tl.constexpr, STORED: tl.constexpr, TEXELS: tl.constexpr, CHANNELS: tl.constexpr,
):  # fmt: skip
    """grad_x, from the gradient that `backward_sums` stored, or gathered again. `grad_sum` may be `grad_x` itself."""
    sample, texel, channel, mask = tile_indices(rows * cols, channels, TEXELS, CHANNELS)
    start = sample * rows * cols * channels
    offset = texel[:, None] * channels + channel[None, :]
    if STORED:
        slope = tl.load(grad_sum + start + offset, mask=mask, other=0).to(tl.float32)
    else:
        slope = sum_gradient(
            grad, grad_features, sample, texel, channel, mask, rows, cols, channels, GRAD_FEATURES, UPSAMPLE, PAD
        )
    if NORM or AFFINE or RELU:
        values = tl.load(x + start + offset, mask=mask, other=0).to(tl.float32)
        values, scale = normalise(values, moments, sample, channel, channels, NORM)
        active, gain = modulate(values, affine, sample, channel, channels, AFFINE)
        if RELU:
            slope = tl.where(active <= 0, 0, slope)
        if NORM:
            # the norm's gradient: less its mean, and less its component along the normalised values
            total, along = two_of_each_channel(sums, sample, channel, channels)
            slope = (slope - (total + values * along) / (rows * cols)) * scale
        slope *= gain
    tl.store(grad_x + start + offset, slope.to(grad_x.dtype.element_ty), mask=mask)
