"""Seeded gradient noise in object space, in NumPy float64; the same on every machine."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.weathering.blocks import by_blocks

_GRADIENTS = np.array([v for v in itertools.product((-1, 0, 1), repeat=3) if np.abs(v).sum() == 2]) / np.sqrt(2.0)
"""The twelve directions from a cube's centre to its edges (Perlin 2002), of unit length."""

_PRIMES = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
_MIX = np.array([0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)
_DIRECTIONS = np.ascontiguousarray(_GRADIENTS.T)
_CORNERS = tuple(itertools.product((0, 1), (0, 1), (0, 1)))

Corner = tuple[int, int, int]
Gradients = tuple[ndarray, ndarray, ndarray]
"""Components along x, y and z, at each point."""
Lookup = Callable[[Corner], Gradients]
"""The gradients at one corner of each point's cell."""


def gradient_noise(points: Float[ndarray, "points 3"], seed: int) -> Float[ndarray, " points"]:
    """Improved gradient noise (Perlin 2002) of unit wavelength, in [-1, 1], twice continuously differentiable.

    The noise has mean zero, standard deviation 0.22, and is zero at lattice points. The 64-bit hash replaces Perlin's
    permutation table, so the noise does not repeat every 256 cells. Points of one neighbourhood are several times as
    fast as scattered ones.
    """
    if not len(points):
        return np.zeros(0)
    place = np.ascontiguousarray(points.T)
    cell = np.floor(place)
    near = place - cell
    sides = near, near - 1.0
    fade = near * near * near * (near * (near * 6.0 - 15.0) + 10.0)
    weights = 1.0 - fade, fade
    gradients = _gradients(cell.astype(np.int64), seed)
    across = {(i, j): weights[i][0] * weights[j][1] for i in (0, 1) for j in (0, 1)}
    total = np.zeros(len(points))
    for corner in _CORNERS:
        (x, y, z), (i, j, k) = gradients(corner), corner
        x *= sides[i][0]
        y *= sides[j][1]
        z *= sides[k][2]
        x += y
        x += z
        x *= across[i, j] * weights[k][2]
        total += x
    return total * (2.0 / np.sqrt(3.0))


def _gradients(cell: Int[ndarray, "3 points"], seed: int) -> Lookup:
    """Hashed once for each lattice point of the cells' box, unless that has more points than the cells have corners."""
    low = cell.min(axis=1)
    shape = cell.max(axis=1) - low + 2
    if np.prod(shape.astype(np.float64)) > len(_CORNERS) * cell.shape[1]:
        sides = _words(cell), _words(cell + 1)
        return lambda corner: _directions([sides[side][axis] for axis, side in enumerate(corner)], seed)
    box = _words(low[:, None] + np.arange(shape.max()))
    x, y, z = _directions(np.ix_(*(line[:count] for line, count in zip(box, shape, strict=True))), seed)
    steps = np.array([shape[1] * shape[2], shape[2], 1])
    first = np.einsum("a,ap->p", steps, cell - low[:, None])

    def at(corner: Corner) -> Gradients:
        index = first + int(steps @ corner)
        return x.take(index), y.take(index), z.take(index)

    return at


def _words(lattice: Int[ndarray, "3 points"]) -> tuple[ndarray, ndarray, ndarray]:
    """Words of 64 bits for each coordinate of lattice points."""
    x, y, z = lattice.view(np.uint64) * _PRIMES[:, None]
    return x, (y << np.uint64(21)) ^ (y >> np.uint64(43)), z


def _directions(words: Sequence[ndarray], seed: int) -> Gradients:
    """Gradients by a 64-bit hash of three words (finaliser of SplitMix64; Steele et al. 2014), flat."""
    value = words[0] ^ words[1] ^ words[2]
    value += np.uint64((seed * 0x9E3779B97F4A7C15) % 2**64)
    value ^= value >> np.uint64(30)
    value *= _MIX[0]
    value ^= value >> np.uint64(27)
    value *= _MIX[1]
    value ^= value >> np.uint64(31)
    kinds = np.uint64(len(_GRADIENTS))
    value -= value // kinds * kinds  # a remainder, for which NumPy has no fast loop
    kind = value.view(np.int64).ravel()
    return _DIRECTIONS[0].take(kind), _DIRECTIONS[1].take(kind), _DIRECTIONS[2].take(kind)


def fbm(points: Float[ndarray, "points 3"], seed: int, *, octaves: int = 3) -> Float[ndarray, " points"]:
    """Fractional Brownian motion: octaves of gradient noise, each twice as fine and half as strong.

    The coarsest octave has unit wavelength. Values lie in [-1, 1] with mean zero; three octaves have standard
    deviation 0.14.
    """
    return by_blocks(lambda block: _fbm(block, seed, octaves), points)


def _fbm(points: Float[ndarray, "points 3"], seed: int, octaves: int) -> Float[ndarray, " points"]:
    total, amplitude, frequency, reach = np.zeros(len(points)), 1.0, 1.0, 0.0
    for octave in range(octaves):
        # Without the shift, the lattice points, where noise is zero, would coincide in all octaves.
        shift = np.array([0.37, 0.71, 0.13]) * (octave + 1)
        total += amplitude * gradient_noise(points * frequency + shift, seed * 64 + octave)
        reach += amplitude
        amplitude, frequency = amplitude / 2, frequency * 2
    return total / reach
