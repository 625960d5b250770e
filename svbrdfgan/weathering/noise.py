"""Seeded gradient noise in object space, in NumPy float64; the same on every machine."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.utils.threads import by_blocks
from svbrdfgan.weathering.lattice_hash import DIRECTIONS, hashed, words

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
        sides = words(cell), words(cell + 1)
        return lambda corner: _directions([sides[side][axis] for axis, side in enumerate(corner)], seed)
    box = words(low[:, None] + np.arange(shape.max()))
    x, y, z = _directions(np.ix_(*(line[:count] for line, count in zip(box, shape, strict=True))), seed)
    steps = np.array([shape[1] * shape[2], shape[2], 1])
    first = np.einsum("a,ap->p", steps, cell - low[:, None])

    def at(corner: Corner) -> Gradients:
        index = first + int(steps @ corner)
        return x.take(index), y.take(index), z.take(index)

    return at


def _directions(words: Sequence[ndarray], seed: int) -> Gradients:
    """Gradients at the lattice points of these words, flat."""
    value = hashed(words, seed)
    kinds = np.uint64(DIRECTIONS.shape[1])
    value -= value // kinds * kinds  # a remainder, for which NumPy has no fast loop
    kind = value.view(np.int64).ravel()
    return DIRECTIONS[0].take(kind), DIRECTIONS[1].take(kind), DIRECTIONS[2].take(kind)


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
