"""Warp functions: the hash of `lattice_hash`, equal to the bit, and the random numbers made from it."""

# mypy: ignore-errors

import warp as wp

from svbrdfgan.weathering.lattice_hash import MIX, PRIMES

X, Y, Z = (wp.constant(wp.uint64(prime)) for prime in PRIMES)
MIX_0, MIX_1 = (wp.constant(wp.uint64(word)) for word in MIX)


@wp.func
def finalised(v: wp.uint64):
    v = (v ^ (v >> wp.uint64(30))) * MIX_0
    v = (v ^ (v >> wp.uint64(27))) * MIX_1
    return v ^ (v >> wp.uint64(31))


@wp.func
def middle(y: wp.uint64):
    """The second coordinate's word."""
    return (y << wp.uint64(21)) ^ (y >> wp.uint64(43))


@wp.func
def hashed(x: int, y: int, z: int, stream: wp.uint64):
    """The hash of a lattice point."""
    return finalised(
        (wp.uint64(wp.int64(x)) * X ^ middle(wp.uint64(wp.int64(y)) * Y) ^ wp.uint64(wp.int64(z)) * Z) + stream
    )


@wp.func
def next_hash(v: wp.uint64):
    return finalised(v + X)


@wp.func
def number12(v: wp.uint64, place: int):
    return float(int((v >> wp.uint64(12 * place)) & wp.uint64(0xFFF))) * (1.0 / 4096.0)


@wp.func
def number16(v: wp.uint64, place: int):
    return float(int((v >> wp.uint64(16 * place)) & wp.uint64(0xFFFF))) * (1.0 / 65536.0)


@wp.func
def four_numbers(v: wp.uint64):
    return wp.vec4(number16(v, 0), number16(v, 1), number16(v, 2), number16(v, 3))


@wp.func
def jitter(v: wp.uint64):
    return wp.vec3(number12(v, 0), number12(v, 1), number12(v, 2)) - wp.vec3(0.5)


@wp.func
def smoothstep(t: float):
    t = wp.clamp(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
