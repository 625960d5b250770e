"""Warp kernels: textures looked up through the records of `kernels.py`, and the transpose of that.

Gradients are summed in float64: in float32 a constant colour's stands still after 2^24 equal additions.
"""

# mypy: ignore-errors

import warp as wp

from svbrdfgan_warp import emitter
from svbrdfgan_warp.kernels import Samples

wp.set_module_options({"enable_backward": False})

RUN = wp.constant(16)
"""Records whose gradients a thread adds up before it passes them on."""


@wp.struct
class Atlas:
    layout: wp.array(dtype=wp.vec3i)  # per part: first texel, rows, cols
    repeat_u: wp.bool
    repeat_v: wp.bool


@wp.func
def placed(i: int, n: int, repeat: bool):
    if repeat:
        return ((i % n) + n) % n
    return wp.clamp(i, 0, n - 1)


@wp.func
def taps(atlas: Atlas, part: int, uv: wp.vec2):
    """The four texels around `uv` and their bilinear weights."""
    layout = atlas.layout[part]
    x = uv[0] * float(layout[2]) - 0.5
    y = uv[1] * float(layout[1]) - 0.5
    col = int(wp.floor(x))
    row = int(wp.floor(y))
    a = x - float(col)
    b = y - float(row)
    left = placed(col, layout[2], atlas.repeat_u)
    right = placed(col + 1, layout[2], atlas.repeat_u)
    below = layout[0] + placed(row, layout[1], atlas.repeat_v) * layout[2]
    above = layout[0] + placed(row + 1, layout[1], atlas.repeat_v) * layout[2]
    texels = wp.vec4i(below + left, below + right, above + left, above + right)
    return texels, wp.vec4((1.0 - a) * (1.0 - b), a * (1.0 - b), (1.0 - a) * b, a * b)


@wp.func
def albedo(atlas: Atlas, texels: wp.array(dtype=wp.vec3), part: int, uv: wp.vec2):
    t, w = taps(atlas, part, uv)
    return texels[t[0]] * w[0] + texels[t[1]] * w[1] + texels[t[2]] * w[2] + texels[t[3]] * w[3]


@wp.kernel
def gather(
    atlas: Atlas,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    image: wp.array(dtype=wp.vec3),
    coverage: wp.array(dtype=wp.float32),
):
    """The chunk's pixels: the sum of weight * base_color over their records."""
    pixel = wp.tid()
    total = wp.vec3(0.0)
    met = int(0)  # noqa: UP018, RUF046
    for sample in range(samples.spp):
        i = pixel * samples.spp + sample
        if part[i] >= 0:
            total += wp.cw_mul(weight[i], albedo(atlas, texels, part[i], uv[i]))
            met += 1
    image[samples.first + pixel] = total
    coverage[samples.first + pixel] = float(met) / float(samples.spp)


@wp.func
def pour(grad_texels: wp.array(dtype=wp.vec3d), place: wp.vec4i, a: wp.vec3, b: wp.vec3, c: wp.vec3, d: wp.vec3):
    """Adds four sums to their texels; where all are one, once. Nothing is added at a place of -1."""
    if place[0] < 0:
        return
    if place[0] == place[3]:
        wp.atomic_add(grad_texels, place[0], wp.vec3d(a + b + c + d))
    else:
        wp.atomic_add(grad_texels, place[0], wp.vec3d(a))
        wp.atomic_add(grad_texels, place[1], wp.vec3d(b))
        wp.atomic_add(grad_texels, place[2], wp.vec3d(c))
        wp.atomic_add(grad_texels, place[3], wp.vec3d(d))


@wp.kernel
def scatter_texels(
    atlas: Atlas,
    samples: Samples,
    records: int,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    weight: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_texels: wp.array(dtype=wp.vec3d),
):
    """The transpose of `gather`: adds weight * grad_image to the texels of each record.

    A thread takes RUN records in a row and adds at once what is for the same texels: else all samples of a part of one
    colour would queue for one texel.
    """
    first = wp.tid() * RUN
    place = wp.vec4i(-1, -1, -1, -1)
    a = wp.vec3(0.0)
    b = wp.vec3(0.0)
    c = wp.vec3(0.0)
    d = wp.vec3(0.0)
    for i in range(first, wp.min(first + RUN, records)):
        if part[i] >= 0:
            t, w = taps(atlas, part[i], uv[i])
            if t[0] != place[0] or t[3] != place[3]:
                pour(grad_texels, place, a, b, c, d)
                place = t
                a = wp.vec3(0.0)
                b = wp.vec3(0.0)
                c = wp.vec3(0.0)
                d = wp.vec3(0.0)
            g = wp.cw_mul(weight[i], grad_image[samples.first + i / samples.spp])
            a += g * w[0]
            b += g * w[1]
            c += g * w[2]
            d += g * w[3]
    pour(grad_texels, place, a, b, c, d)


@wp.kernel
def scatter_light(
    atlas: Atlas,
    samples: Samples,
    part: wp.array(dtype=wp.int32),
    uv: wp.array(dtype=wp.vec2),
    arrivals: wp.array2d(dtype=wp.vec3),
    texels: wp.array(dtype=wp.vec3),
    grad_image: wp.array(dtype=wp.vec3),
    grad_light: wp.array2d(dtype=wp.vec3d),
):
    """The transpose of `light_up` and `gather`: adds share * base_color * grad_image to the pixels of each arrival."""
    i = wp.tid()
    if part[i] >= 0:
        g = wp.cw_mul(albedo(atlas, texels, part[i], uv[i]), grad_image[samples.first + i / samples.spp])
        for j in range(2):
            arrival = arrivals[i, j]
            if arrival[2] > 0.0:
                at = wp.vec2(arrival[0], arrival[1])
                row, col, w = emitter.taps(grad_light.shape[0], grad_light.shape[1], at)
                for k in range(4):
                    wp.atomic_add(grad_light, row[k], col[k], wp.vec3d(g * (arrival[2] * w[k])))
