"""Random fields and numbers of a seed: what a generator draws from.

Everything is computed in whole numbers (torch int64, which wraps at 64 bits), and only the result becomes float32, by
one multiplication. So what a seed gives is equal to the bit on any machine and device. `svbrdfgan.weathering.noise`,
which paints the recipes, is its relative in float64; both stay as they are, since stored layers depend on the one and
trained models on the other.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cache

import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.utils.threads import BLOCK, in_threads
from svbrdfgan.utils.triton_works import triton_works

MOST_FIELDS = 9
"""Field `MOST_FIELDS - 1` has 512 waves a vehicle length; finer ones would not have 16 bits within a wave."""
MOST_SEEDS = 2**63
"""Seeds are whole numbers from 0 to `MOST_SEEDS - 1`."""

GRID_BITS = 24  # positions are rounded to 2^-24 of half a vehicle length, which is the precision of float32 there
FRACTION_BITS = 16  # of a position within one cell, and of weights
_ONE = 1 << FRACTION_BITS
_DIRECTIONS = [v for v in itertools.product((-1, 0, 1), repeat=3) if sum(map(abs, v)) == 2]
_SQUARE = 128
"""Texels along a side of what a thread computes at once: few enough for its cache, and to see few cells."""
_MOST_CELLS = 4
"""Cells for each texel, at most, in a table: larger ones take longer than to hash the corners of each texel's cell."""
_DEVIATION = 0.27
"""Standard deviation of a field whose directions have length sqrt(2); measured."""


def _signed(word: int) -> int:
    """A 64-bit word as the whole number that int64 has for it."""
    return word - 2**64 if word >= 2**63 else word


PRIMES = tuple(_signed(word) for word in (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9))
MIX = tuple(_signed(word) for word in (0xBF58476D1CE4E5B9, 0x94D049BB133111EB))


def random_fields(
    position: Float[Tensor, "batch 3 rows cols"], seeds: Int[Tensor, " batch"], fields: int
) -> Float[Tensor, "batch fields rows cols"]:
    """Gradient noise (Perlin 2002) of object space, one field for each octave: 2, 4, 8, ... waves a vehicle length.

    Each field has mean zero and standard deviation one, and is twice continuously differentiable in the position. The
    lattice is turned away from the axes, since the panels of vehicles lie along them. Fields are functions of position
    and seed alone, so they continue across the seams of a texture. Fields of a seed, and fields of different seeds, are
    independent. The result has no gradient.

    Args:
        position: as in a generator's input, in units of half a vehicle length (`GeometryBuffer.network_input`);
            rounded to 2^-24 of that.
        seeds: at least 0.
        fields: at most `MOST_FIELDS`.
    """
    grid = _turned((position.detach().float() * float(1 << GRID_BITS)).round().long())
    octaves = torch.arange(fields, device=grid.device)
    streams = _hashed(_hashed(seeds)[:, None] + octaves * PRIMES[0])
    within = (1 << (GRID_BITS - octaves)[:, None]) - 1
    # without a shift the lattices, on which fields are zero, would coincide
    shift = torch.stack([_hashed(streams + prime) for prime in PRIMES], dim=-1) & within
    return _noise(grid, shift, streams) * (1.0 / (_ONE * _DEVIATION))


def random_numbers(seeds: Int[Tensor, " batch"], count: int) -> Float[Tensor, "batch count"]:
    """Nearly Gaussian numbers of each seed: sums of twelve uniform ones, with mean zero and standard deviation one."""
    places = torch.arange(count * 3, device=seeds.device) * PRIMES[1]
    words = _hashed(_hashed(seeds + 1)[:, None] ^ _hashed(places)).view(len(seeds), count, 3)
    total = sum(_shifted(words, bits) & (_ONE - 1) for bits in (0, 16, 32, 48))
    assert isinstance(total, Tensor)
    return (2 * total.sum(dim=-1) - 12 * (_ONE - 1)).float() * (0.5 / _ONE)


def _turned(grid: Int[Tensor, "batch 3 rows cols"]) -> Int[Tensor, "batch 3 rows cols"]:
    """Turned by a rotation of whole thirds: its axes are 48 degrees from the old ones, or 71."""
    x, y, z = grid.unbind(dim=1)
    turned = torch.stack([2 * x - y + 2 * z, 2 * x + 2 * y - z, 2 * y + 2 * z - x], dim=1)
    return torch.div(turned, 3, rounding_mode="floor")


def _noise(
    grid: Int[Tensor, "batch 3 rows cols"], shift: Int[Tensor, "batch fields 3"], streams: Int[Tensor, "batch fields"]
) -> Float[Tensor, "batch fields rows cols"]:
    """The result of `noise_reference`, by a Triton kernel where that works; on a CPU by tables, of large maps."""
    batch, _, rows, cols = grid.shape
    if grid.device.type == "cpu" and rows * cols >= _SQUARE**2:
        return _noise_by_tables(grid, shift, streams)
    if grid.device.type == "cpu":  # by blocks, three times as fast as all at once
        parts = grid.split(max(BLOCK // (batch * cols), 1), dim=2)
        return torch.cat([*in_threads(lambda part: noise_reference(part, shift, streams), parts)], dim=2).float()
    if not triton_works(grid.device):
        return noise_reference(grid, shift, streams).float()
    from svbrdfgan.networks.random_fields_kernel import noise_triton

    return noise_triton(grid, shift, streams)


def noise_reference(
    grid: Int[Tensor, "batch 3 rows cols"], shift: Int[Tensor, "batch fields 3"], streams: Int[Tensor, "batch fields"]
) -> Int[Tensor, "batch fields rows cols"]:
    """The noise of each field, in units of 2^-16.

    Args:
        grid: positions in units of 2^-24 of the first field's cells.
        shift: of each field's lattice.
        streams: a word of each field, which selects its directions.
    """
    fields = range(streams.shape[1])  # all at once take twice the time: they do not fit a cache
    return torch.stack([_field(grid, n, shift[:, n, :, None, None], streams[:, n, None, None]) for n in fields], dim=1)


def _field(
    grid: Int[Tensor, "batch 3 rows cols"], number: int, shift: Int[Tensor, "*batch 3 1 1"], stream: Int[Tensor, "*one"]
) -> Int[Tensor, "batch rows cols"]:
    bits = GRID_BITS - number  # within one cell
    moved = grid + shift
    return _interpolated(moved >> bits, _within_cell(moved, bits), stream)


def _within_cell(moved: Int[Tensor, "*shape"], bits: int) -> Int[Tensor, "*shape"]:
    """The place within a cell, in units of 2^-16."""
    return (moved & ((1 << bits) - 1)) >> (bits - FRACTION_BITS)


def _noise_by_tables(
    grid: Int[Tensor, "batch 3 rows cols"], shift: Int[Tensor, "batch fields 3"], streams: Int[Tensor, "batch fields"]
) -> Float[Tensor, "batch fields rows cols"]:
    """`noise_reference` in squares of texels, whose neighbours share the corners of cells: in half of its time."""
    batch, _, rows, cols = grid.shape
    made = torch.empty(batch, streams.shape[1], rows, cols)

    def fill(corner: tuple[int, int, int]) -> None:
        sample, top, left = corner
        place = (slice(top, top + _SQUARE), slice(left, left + _SQUARE))
        square = grid[sample, :, *place]
        least, most = torch.aminmax(square.flatten(1), dim=1)
        for number, (moved, stream) in enumerate(zip(shift[sample], streams[sample], strict=True)):
            first, last = ((end + moved) >> (GRID_BITS - number) for end in (least, most))
            sizes = (last - first + 2).tolist()  # corners of cells
            few = math.prod(sizes) <= _MOST_CELLS * square[0].numel()
            made[sample, number, *place] = (
                _field_by_table(square, number, moved, _Corners.of(stream, first, sizes))
                if few
                else _field(square[None], number, moved[:, None, None], stream)[0]
            )

    for _ in in_threads(fill, itertools.product(range(batch), range(0, rows, _SQUARE), range(0, cols, _SQUARE))):
        pass
    return made


@dataclass(frozen=True, eq=False)
class _Corners:
    """The directions at all corners of a box of cells.

    Attributes:
        first: the least cell of each axis.
        strides: between neighbours along each axis, in `directions`.
        directions: x, y and z.
    """

    first: Int[Tensor, " 3"]
    strides: tuple[int, int, int]
    directions: list[Float[Tensor, " corners"]]

    @classmethod
    def of(cls, stream: Int[Tensor, ""], first: Int[Tensor, " 3"], sizes: list[int]) -> _Corners:
        x, y, z = (torch.arange(size) + start for start, size in zip(first, sizes, strict=True))
        words = _word(x, 0)[:, None, None] ^ _word(y, 1)[:, None] ^ _word(z, 2)
        kind = _kind(words.flatten() + stream)
        steps = [toward.take(kind).double() for toward in directions(kind.device)]
        return cls(first, (sizes[1] * sizes[2], sizes[2], 1), steps)


def _field_by_table(
    grid: Int[Tensor, "3 rows cols"], number: int, shift: Int[Tensor, " 3"], corners: _Corners
) -> Float[Tensor, "rows cols"]:
    """`_field` in double precision, in which all its numbers are whole, and products are exact."""
    bits, flat = GRID_BITS - number, grid.flatten(1)
    moved = flat + shift[:, None]
    cell = (moved >> bits) - corners.first[:, None]
    index = sum(axis * stride for axis, stride in zip(cell, corners.strides, strict=True))
    assert isinstance(index, Tensor)
    low = _within_cell(moved, bits).double()
    sides, values = (low, low - _ONE), []
    for corner in itertools.product((0, 1), repeat=3):
        start = sum(side * stride for side, stride in zip(corner, corners.strides, strict=True))
        x, y, z = (
            steps[start:].index_select(0, index).mul_(sides[side][axis])
            for axis, (side, steps) in enumerate(zip(corner, corners.directions, strict=True))
        )
        values.append(x.add_(y).add_(z))
    for share in reversed(_faded_exactly(low)):
        values = [
            low.add_(high.sub_(low).mul_(share).floor_()) for low, high in zip(values[::2], values[1::2], strict=True)
        ]
    return values[0].view(grid.shape[1:])


def _faded_exactly(t: Float[Tensor, "*shape"]) -> Float[Tensor, "*shape"]:
    """`_faded` of whole numbers in double precision, as a share of 1."""
    unit = 1.0 / _ONE
    inner = (t * (6 * t - 15 * _ONE)).mul_(unit).floor_().add_(10 * _ONE)
    cubed = (t * t).mul_(unit).floor_().mul_(t).mul_(unit).floor_()
    return cubed.mul_(inner).mul_(unit).floor_().mul_(unit)


def _interpolated(
    cell: Int[Tensor, "batch 3 rows cols"], offset: Int[Tensor, "batch 3 rows cols"], streams: Int[Tensor, "*one"]
) -> Int[Tensor, "batch rows cols"]:
    """The noise, in units of 2^-16: linear functions of the cell's corners, mixed by the quintic fade."""
    fade = _faded(offset)
    words = [(_word(cell[:, axis], axis), _word(cell[:, axis] + 1, axis)) for axis in range(3)]
    towards = directions(cell.device)
    values = []
    for corner in itertools.product((0, 1), repeat=3):
        x, y, z = (words[axis][side] for axis, side in enumerate(corner))
        kind = _kind((x ^ y ^ z) + streams)
        steps = [offset[:, axis] - side * _ONE for axis, side in enumerate(corner)]
        first, second, third = (step * toward.take(kind) for step, toward in zip(steps, towards, strict=True))
        values.append(first + second + third)
    for axis in (2, 1, 0):  # corners that differ in this axis alone are neighbours in the list
        share = fade[:, axis]
        values = [
            low + (((high - low) * share) >> FRACTION_BITS) for low, high in zip(values[::2], values[1::2], strict=True)
        ]
    return values[0]


def _word(coordinate: Int[Tensor, "*shape"], axis: int) -> Int[Tensor, "*shape"]:
    """A word of 64 bits for the coordinate of a lattice's corner along an axis."""
    word = coordinate * PRIMES[axis]
    return (word << 21) ^ _shifted(word, 43) if axis == 1 else word


def _kind(words: Int[Tensor, "*shape"]) -> Int[Tensor, "*shape"]:
    """The index of a direction: each for as many words, but for one in 2^28."""
    return (_shifted(_hashed(words), 32) * len(_DIRECTIONS)) >> 32


@cache
def directions(device: torch.device) -> list[Int[Tensor, " directions"]]:
    """The x, y and z of each direction; kept on the device, since each copy there would wait for it."""
    return [torch.tensor(steps, device=device) for steps in zip(*_DIRECTIONS, strict=True)]


def _faded(t: Int[Tensor, "*shape"]) -> Int[Tensor, "*shape"]:
    """t^3 (6 t^2 - 15 t + 10), in units of 2^-16."""
    inner = ((t * (6 * t - 15 * _ONE)) >> FRACTION_BITS) + 10 * _ONE
    return ((((t * t) >> FRACTION_BITS) * t >> FRACTION_BITS) * inner) >> FRACTION_BITS


def _hashed(words: Int[Tensor, "*shape"]) -> Int[Tensor, "*shape"]:
    """A 64-bit hash of each word (finaliser of SplitMix64; Steele et al. 2014)."""
    words = words + PRIMES[0]
    words = (words ^ _shifted(words, 30)) * MIX[0]
    words = (words ^ _shifted(words, 27)) * MIX[1]
    return words ^ _shifted(words, 31)


def _shifted(words: Int[Tensor, "*shape"], bits: int) -> Int[Tensor, "*shape"]:
    """The words moved right by this number of bits; zeros come in from the left, where `>>` repeats the sign."""
    return (words >> bits) & ((1 << (64 - bits)) - 1) if bits else words
