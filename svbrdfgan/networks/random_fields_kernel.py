"""The Triton kernel of `random_fields`: its lattice noise in one pass, equal to the bit, since all numbers are whole.

As torch's own operations the noise takes hundreds of passes over memory.
"""
# mypy: disable-error-code="no-untyped-def"
# ruff: noqa: N803

from __future__ import annotations

import torch
import triton  # type: ignore[import-not-found, import-untyped, unused-ignore]
import triton.language as tl  # type: ignore[import-not-found, import-untyped, unused-ignore]
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.networks.random_fields import FRACTION_BITS, GRID_BITS, MIX, PRIMES, directions

_TEXELS = 256  # of one program
_GRID = tl.constexpr(GRID_BITS)
_FRACTION = tl.constexpr(FRACTION_BITS)
_ONE = tl.constexpr(1 << FRACTION_BITS)
_X, _Y, _Z = (tl.constexpr(prime) for prime in PRIMES)
_MIX_0, _MIX_1 = (tl.constexpr(word) for word in MIX)


def noise_triton(
    grid: Int[Tensor, "batch 3 rows cols"], shift: Int[Tensor, "batch fields 3"], streams: Int[Tensor, "batch fields"]
) -> Float[Tensor, "batch fields rows cols"]:
    """The result of `noise_reference`, as float32, which holds these whole numbers exactly."""
    (batch, fields), (rows, cols) = streams.shape, grid.shape[2:]
    made = torch.empty(batch, fields, rows, cols, device=grid.device)
    towards = torch.stack(directions(grid.device))
    launch = (triton.cdiv(rows * cols, _TEXELS), batch * fields)
    _noise[launch](
        grid.contiguous(), shift.contiguous(), streams.contiguous(), towards, made,
        fields, rows * cols, towards.shape[1], TEXELS=_TEXELS,
    )  # fmt: skip
    return made


@triton.jit
def _noise(grid, shift, streams, towards, made, fields, texels, kinds, TEXELS: tl.constexpr):
    field = tl.program_id(1).to(tl.int64)
    sample, octave = field // fields, field % fields
    texel = tl.program_id(0) * TEXELS + tl.arange(0, TEXELS)
    mask = texel < texels
    stream = tl.load(streams + field)
    bits = _GRID - octave  # of a position within one cell
    place = grid + sample * 3 * texels + texel
    x = tl.load(place, mask=mask, other=0) + tl.load(shift + 3 * field)
    y = tl.load(place + texels, mask=mask, other=0) + tl.load(shift + 3 * field + 1)
    z = tl.load(place + 2 * texels, mask=mask, other=0) + tl.load(shift + 3 * field + 2)
    u, v, w = offset(x, bits), offset(y, bits), offset(z, bits)
    x0, y0, z0 = (x >> bits) * _X, rotated((y >> bits) * _Y), (z >> bits) * _Z
    x1, y1, z1 = ((x >> bits) + 1) * _X, rotated(((y >> bits) + 1) * _Y), ((z >> bits) + 1) * _Z
    u1, v1, w1 = u - _ONE, v - _ONE, w - _ONE
    along_x, along_y, along_z = faded(u), faded(v), faded(w)
    v000 = corner((x0 ^ y0 ^ z0) + stream, u, v, w, towards, kinds)
    v001 = corner((x0 ^ y0 ^ z1) + stream, u, v, w1, towards, kinds)
    v010 = corner((x0 ^ y1 ^ z0) + stream, u, v1, w, towards, kinds)
    v011 = corner((x0 ^ y1 ^ z1) + stream, u, v1, w1, towards, kinds)
    v100 = corner((x1 ^ y0 ^ z0) + stream, u1, v, w, towards, kinds)
    v101 = corner((x1 ^ y0 ^ z1) + stream, u1, v, w1, towards, kinds)
    v110 = corner((x1 ^ y1 ^ z0) + stream, u1, v1, w, towards, kinds)
    v111 = corner((x1 ^ y1 ^ z1) + stream, u1, v1, w1, towards, kinds)
    v00, v01 = between(v000, v001, along_z), between(v010, v011, along_z)
    v10, v11 = between(v100, v101, along_z), between(v110, v111, along_z)
    noise = between(between(v00, v01, along_y), between(v10, v11, along_y), along_x)
    tl.store(made + field * texels + texel, noise.to(tl.float32), mask=mask)


@triton.jit
def offset(position, bits):
    """The place within the cell, in units of 2^-16."""
    one = bits * 0 + 1  # 1 in the type of `bits`, so that it is shifted in 64 bits
    return (position & ((one << bits) - 1)) >> (bits - _FRACTION)


@triton.jit
def corner(word, x, y, z, towards, kinds):
    """The linear function of a corner of the lattice, at a place relative to it."""
    # the masks, here and below, clear the copies of the sign that `>>` brings in from the left
    kind = (((hashed(word) >> 32) & 0xFFFFFFFF) * kinds) >> 32
    first, second = x * tl.load(towards + kind), y * tl.load(towards + kinds + kind)
    return first + second + z * tl.load(towards + 2 * kinds + kind)


@triton.jit
def between(low, high, share):
    return low + (((high - low) * share) >> _FRACTION)


@triton.jit
def faded(t):
    inner = ((t * (6 * t - 15 * _ONE)) >> _FRACTION) + 10 * _ONE
    return ((((t * t) >> _FRACTION) * t >> _FRACTION) * inner) >> _FRACTION


@triton.jit
def rotated(word):
    return (word << 21) ^ ((word >> 43) & 0x1FFFFF)


@triton.jit
def hashed(words):
    words = words + _X
    words = (words ^ ((words >> 30) & 0x3FFFFFFFF)) * _MIX_0
    words = (words ^ ((words >> 27) & 0x1FFFFFFFFF)) * _MIX_1
    return words ^ ((words >> 31) & 0x1FFFFFFFF)
