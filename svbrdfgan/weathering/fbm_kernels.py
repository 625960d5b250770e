"""Warp kernels of `fbm`; `noise_reference` defines it.

A coordinate is split into lattice point and remainder before an octave's shift is added, which float32 does exactly. So
results are within float32 rounding of the reference, however far from the origin.
"""

# mypy: ignore-errors
# ruff: noqa: UP018 - Warp's way to declare a variable

import warp as wp

from svbrdfgan.weathering.hash_kernels import X, Y, Z, finalised, middle

wp.set_module_options({"enable_backward": False})


@wp.func
def fade(t: float):
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@wp.func
def steep(t: float):
    """The derivative of `fade`."""
    return 30.0 * t * t * (t - 1.0) * (t - 1.0)


@wp.func
def corner(word: wp.uint64, stream: wp.uint64, near: wp.vec3, directions: wp.array(dtype=wp.vec3)):
    """What a corner of the cell adds: a linear function's value and its gradient."""
    toward = directions[int(finalised(word + stream) % wp.uint64(12))]
    return wp.vec4(wp.dot(toward, near), toward[0], toward[1], toward[2])


@wp.func
def gradient_noise(
    x: wp.int64, y: wp.int64, z: wp.int64, near: wp.vec3, stream: wp.uint64, directions: wp.array(dtype=wp.vec3)
):
    """Value and gradient in the cell at x, y, z."""
    u, v, w = near[0], near[1], near[2]
    x0 = wp.uint64(x) * X
    x1 = x0 + X
    y0 = wp.uint64(y) * Y
    y1 = middle(y0 + Y)
    y0 = middle(y0)
    z0 = wp.uint64(z) * Z
    z1 = z0 + Z
    a = corner(x0 ^ y0 ^ z0, stream, wp.vec3(u, v, w), directions)
    b = corner(x1 ^ y0 ^ z0, stream, wp.vec3(u - 1.0, v, w), directions)
    c = corner(x0 ^ y1 ^ z0, stream, wp.vec3(u, v - 1.0, w), directions)
    d = corner(x1 ^ y1 ^ z0, stream, wp.vec3(u - 1.0, v - 1.0, w), directions)
    e = corner(x0 ^ y0 ^ z1, stream, wp.vec3(u, v, w - 1.0), directions)
    f = corner(x1 ^ y0 ^ z1, stream, wp.vec3(u - 1.0, v, w - 1.0), directions)
    g = corner(x0 ^ y1 ^ z1, stream, wp.vec3(u, v - 1.0, w - 1.0), directions)
    h = corner(x1 ^ y1 ^ z1, stream, wp.vec3(u - 1.0, v - 1.0, w - 1.0), directions)
    fu, fv, fw = fade(u), fade(v), fade(w)
    ab, cd, ef, gh = a + fu * (b - a), c + fu * (d - c), e + fu * (f - e), g + fu * (h - g)
    low, high = ab + fv * (cd - ab), ef + fv * (gh - ef)
    along_x = wp.lerp(wp.lerp(b[0] - a[0], d[0] - c[0], fv), wp.lerp(f[0] - e[0], h[0] - g[0], fv), fw)
    along_y = wp.lerp(cd[0] - ab[0], gh[0] - ef[0], fw)
    total = low + fw * (high - low)
    total += wp.vec4(0.0, steep(u) * along_x, steep(v) * along_y, steep(w) * (high[0] - low[0]))
    return total * 1.1547005  # 2 / sqrt(3)


@wp.func
def octave_noise(p: wp.vec3, octave: int, stream: wp.uint64, directions: wp.array(dtype=wp.vec3)):
    """Value and gradient of an octave of `fbm`, as functions of p scaled to its cells."""
    shift = wp.vec3(0.37, 0.71, 0.13) * float(octave + 1)
    whole = wp.vec3(wp.floor(p[0]), wp.floor(p[1]), wp.floor(p[2]))
    near = p - whole + shift
    over = wp.vec3(wp.floor(near[0]), wp.floor(near[1]), wp.floor(near[2]))
    x = wp.int64(whole[0]) + wp.int64(over[0])
    y = wp.int64(whole[1]) + wp.int64(over[1])
    z = wp.int64(whole[2]) + wp.int64(over[2])
    return gradient_noise(x, y, z, near - over, stream + wp.uint64(octave) * X, directions)


@wp.kernel
def fbm(
    points: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    stream: wp.uint64,
    octaves: int,
    gain: float,
    last: float,  # the strength of the last octave
    scale: float,  # of the sum
    value: wp.array(dtype=float),
):
    i = wp.tid()
    total, weight, frequency = float(0.0), float(scale), float(1.0)
    for octave in range(octaves):
        if octave == octaves - 1:
            weight = last
        total += weight * octave_noise(points[i] * frequency, octave, stream, directions)[0]
        weight *= gain
        frequency *= 2.0
    value[i] = total


@wp.kernel
def fbm_and_slope(
    points: wp.array(dtype=wp.vec3),
    directions: wp.array(dtype=wp.vec3),
    stream: wp.uint64,
    octaves: int,
    gain: float,
    last: float,
    scale: float,
    value: wp.array(dtype=float),
    slope: wp.array(dtype=wp.vec3),
):
    i = wp.tid()
    total, weight, frequency = wp.vec4(), float(scale), float(1.0)
    for octave in range(octaves):
        if octave == octaves - 1:
            weight = last
        n = octave_noise(points[i] * frequency, octave, stream, directions)
        total += weight * wp.vec4(n[0], frequency * n[1], frequency * n[2], frequency * n[3])
        weight *= gain
        frequency *= 2.0
    value[i] = total[0]
    slope[i] = wp.vec3(total[1], total[2], total[3])
