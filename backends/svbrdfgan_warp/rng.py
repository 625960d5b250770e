"""Warp functions: random numbers that depend only on pixel, sample and seed, and directions made from them."""

# mypy: ignore-errors

import warp as wp

UNIT = wp.constant(1.0 / 16777216.0)  # 2^-24: float32 holds 24 bits, so that no number is rounded up to 1
# An extensible lattice (Hickernell, Hong, L'Ecuyer and Lemieux, SIAM J. Sci. Comput. 22, 2000) of up to 2^20 points,
# found by `benchmarks/lattice.py`: any power of two of its first points lies evenly in the plane of u[0] and u[1], of
# u[2] and u[3], and of v[0] and v[1], and not too unevenly in any other two dimensions.
LATTICE_U = wp.constant(wp.vec4ui(1, 494565, 1010577, 652213))
LATTICE_V = wp.constant(wp.vec2ui(616297, 885741))


@wp.func
def hashed(pixel: wp.uint32, low: wp.uint32, high: wp.uint32, stream: wp.uint32):
    """Four random numbers: pcg4d of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 2020."""
    m = wp.uint32(1664525)
    c = wp.uint32(1013904223)
    x = pixel * m + c
    y = low * m + c
    z = high * m + c
    w = stream * m + c
    for i in range(2):
        x += y * w
        y += z * x
        z += x * y
        w += y * z
        if i == 0:
            x = x ^ (x >> wp.uint32(16))
            y = y ^ (y >> wp.uint32(16))
            z = z ^ (z >> wp.uint32(16))
            w = w ^ (w >> wp.uint32(16))
    return wp.vec4ui(x, y, z, w)


@wp.func
def reversed_bits(i: wp.uint32):
    i = (i << wp.uint32(16)) | (i >> wp.uint32(16))
    i = ((i & wp.uint32(0x00FF00FF)) << wp.uint32(8)) | ((i >> wp.uint32(8)) & wp.uint32(0x00FF00FF))
    i = ((i & wp.uint32(0x0F0F0F0F)) << wp.uint32(4)) | ((i >> wp.uint32(4)) & wp.uint32(0x0F0F0F0F))
    i = ((i & wp.uint32(0x33333333)) << wp.uint32(2)) | ((i >> wp.uint32(2)) & wp.uint32(0x33333333))
    return ((i & wp.uint32(0x55555555)) << wp.uint32(1)) | ((i >> wp.uint32(1)) & wp.uint32(0x55555555))


@wp.func
def unit(bits: wp.uint32):
    """A random float in [0, 1)."""
    return float(bits >> wp.uint32(8)) * UNIT


@wp.func
def numbers(pixel: int, sample: int, low: wp.uint32, high: wp.uint32):
    """Six random numbers: a lattice, randomly shifted in each pixel (Cranley and Patterson, 1976).

    Each sample is uniform; together the samples of a pixel are spread more evenly than independent ones.
    """
    i = reversed_bits(wp.uint32(sample))
    u = hashed(wp.uint32(pixel), low, high, wp.uint32(0)) + LATTICE_U * i
    v = hashed(wp.uint32(pixel), low, high, wp.uint32(1))
    return u, wp.vec2ui(v[0], v[1]) + LATTICE_V * i


@wp.func
def tangents(n: wp.vec3):
    """Two unit vectors perpendicular to a unit vector and to each other: the frame of Duff et al., JCGT 2017."""
    sign = wp.where(n[2] >= 0.0, 1.0, -1.0)
    c = -1.0 / (sign + n[2])
    e = n[0] * n[1] * c
    return wp.vec3(1.0 + sign * n[0] * n[0] * c, sign * e, -sign * n[0]), wp.vec3(e, sign + n[1] * n[1] * c, -n[1])


@wp.func
def cosine_direction(n: wp.vec3, a: float, b: float):
    """A direction about `n` with density cosine / pi."""
    s, t = tangents(n)
    radius = wp.sqrt(a)
    angle = b * wp.tau
    return wp.normalize(s * (radius * wp.cos(angle)) + t * (radius * wp.sin(angle)) + n * wp.sqrt(1.0 - a))
