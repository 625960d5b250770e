"""Warp kernels that look up textures for the records of `trace_kernels`, and the transposes, written by hand.

By hand, because Warp's own adjoints would fail silently: that of `wp.texture_sample` is empty, and loops of variable
length are not replayed. Gradients are summed in float64: the float32 sum of a constant colour would stop growing after
2^24 equal additions.
"""

# mypy: ignore-errors

from typing import Any

import warp as wp

from svbrdfgan_warp import emitter
from svbrdfgan_warp.trace_kernels import SampleRange

wp.set_module_options({"enable_backward": False})

RECORDS_PER_THREAD = wp.constant(16)
"""Consecutive records whose gradients one thread sums before it adds them to memory."""


@wp.struct
class Atlas:
    layout: wp.array(dtype=wp.vec3i)  # per part: first texel, rows, cols
    repeat_u: wp.bool
    repeat_v: wp.bool


@wp.func
def texel_index(i: int, n: int, repeat: bool):
    """The index along one axis, repeated or clamped to [0, n)."""
    if repeat:
        return ((i % n) + n) % n
    return wp.clamp(i, 0, n - 1)


@wp.func
def bilinear_taps(first: int, rows: int, cols: int, repeat_u: bool, repeat_v: bool, uv: wp.vec2):
    """The four texels around `uv` of a texture whose first texel is `first`, and their bilinear weights."""
    x = uv[0] * float(cols) - 0.5
    y = uv[1] * float(rows) - 0.5
    col = int(wp.floor(x))
    row = int(wp.floor(y))
    a = x - float(col)
    b = y - float(row)
    left = texel_index(col, cols, repeat_u)
    right = texel_index(col + 1, cols, repeat_u)
    below = first + texel_index(row, rows, repeat_v) * cols
    above = first + texel_index(row + 1, rows, repeat_v) * cols
    texels = wp.vec4i(below + left, below + right, above + left, above + right)
    return texels, wp.vec4((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b)


@wp.func
def taps(atlas: Atlas, part: int, uv: wp.vec2):
    """The four texels around `uv` of a part's texture, and their bilinear weights."""
    layout = atlas.layout[part]
    return bilinear_taps(layout[0], layout[1], layout[2], atlas.repeat_u, atlas.repeat_v, uv)


@wp.func
def lookup(atlas: Atlas, texels: wp.array(dtype=Any), part: int, uv: wp.vec2):
    """The map of a part at `uv`, bilinear between texel centres."""
    t, w = taps(atlas, part, uv)
    return texels[t[0]] * w[0] + texels[t[1]] * w[1] + texels[t[2]] * w[2] + texels[t[3]] * w[3]


@wp.kernel
def gather(
    atlas: Atlas,
    samples: SampleRange,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    coverage: wp.array(dtype=wp.float32),
):
    """The pixels of a film chunk: the sum of weight * base_color over the pixel's records, and its coverage."""
    pixel = wp.tid()
    total = wp.vec3(0.0)
    hits = int(0)  # noqa: UP018, RUF046
    for sample in range(samples.spp):
        i = pixel * samples.spp + sample
        if part[i] >= 0:
            total += wp.cw_mul(weight[i], lookup(atlas, texels, part[i], uv[i]))
            hits += 1
    image[samples.first + pixel] = total
    coverage[samples.first + pixel] = float(hits) / float(samples.spp)


@wp.func
def add_to_texels(sums: wp.array(dtype=Any), texel: wp.vec4i, a: Any, b: Any, c: Any, d: Any):
    """Adds four sums to their texels, at once if the texels are one and the same. A texel of -1 means none."""
    if texel[0] < 0:
        return
    if texel[0] == texel[3]:
        wp.atomic_add(sums, texel[0], sums.dtype(a + b + c + d))
    else:
        wp.atomic_add(sums, texel[0], sums.dtype(a))
        wp.atomic_add(sums, texel[1], sums.dtype(b))
        wp.atomic_add(sums, texel[2], sums.dtype(c))
        wp.atomic_add(sums, texel[3], sums.dtype(d))


@wp.kernel
def scatter_texels(
    atlas: Atlas,
    samples: SampleRange,
    records: int,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_texels: wp.array(dtype=wp.vec3d),
):
    """The transpose of `gather`: adds weight * grad_image to the texels of each record.

    Each thread takes consecutive records, which often hit the same texels, and adds each run of equal texels at once.
    Otherwise all samples of a part of constant colour would contend for one texel.
    """
    first = wp.tid() * RECORDS_PER_THREAD
    texel = wp.vec4i(-1, -1, -1, -1)
    a = wp.vec3(0.0)
    b = wp.vec3(0.0)
    c = wp.vec3(0.0)
    d = wp.vec3(0.0)
    for i in range(first, wp.min(first + RECORDS_PER_THREAD, records)):
        if part[i] >= 0:
            t, w = taps(atlas, part[i], uv[i])
            if t[0] != texel[0] or t[3] != texel[3]:
                add_to_texels(grad_texels, texel, a, b, c, d)
                texel = t
                a = wp.vec3(0.0)
                b = wp.vec3(0.0)
                c = wp.vec3(0.0)
                d = wp.vec3(0.0)
            g = wp.cw_mul(weight[i], grad_image[samples.first + i / samples.spp])
            a += g * w[0]
            b += g * w[1]
            c += g * w[2]
            d += g * w[3]
    add_to_texels(grad_texels, texel, a, b, c, d)


@wp.kernel
def scatter_radiance(
    atlas: Atlas,
    samples: SampleRange,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    light_samples: wp.array2d(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_radiance: wp.array2d(dtype=wp.vec3d),
):
    """The transpose for the radiance: adds factor * base_color * grad_image to the pixels of each light sample."""
    i = wp.tid()
    if part[i] >= 0:
        g = wp.cw_mul(lookup(atlas, texels, part[i], uv[i]), grad_image[samples.first + i / samples.spp])
        for j in range(2):
            light = light_samples[i, j]
            if light[2] > 0.0:
                at = wp.vec2(light[0], light[1])
                row, col, w = emitter.taps(grad_radiance.shape[0], grad_radiance.shape[1], at)
                for k in range(4):
                    wp.atomic_add(grad_radiance, row[k], col[k], wp.vec3d(g * (light[2] * w[k])))
