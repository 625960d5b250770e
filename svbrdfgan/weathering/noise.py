"""Seeded gradient noise in object space, in NumPy float64; the same on every machine."""

from __future__ import annotations

import itertools
from functools import reduce

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.weathering.blocks import by_blocks

_GRADIENTS = np.array([v for v in itertools.product((-1, 0, 1), repeat=3) if np.abs(v).sum() == 2]) / np.sqrt(2.0)
"""The twelve directions from a cube's centre to its edges (Perlin 2002), of unit length."""

_PRIMES = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
_MIX = np.array([0xBF58476D1CE4E5B9, 0x94D049BB133111EB], dtype=np.uint64)


def gradient_noise(points: Float[ndarray, "points 3"], seed: int) -> Float[ndarray, " points"]:
    """Improved gradient noise (Perlin 2002) of unit wavelength, in [-1, 1], twice continuously differentiable.

    The noise has mean zero, standard deviation 0.22, and is zero at lattice points. The 64-bit hash replaces Perlin's
    permutation table, so the noise does not repeat every 256 cells.
    """
    cell = np.floor(points)
    offset = points - cell
    fade = offset * offset * offset * (offset * (offset * 6.0 - 15.0) + 10.0)
    weights, words = (1.0 - fade.T, fade.T), _words(cell.astype(np.int64))
    total = np.zeros(len(points))
    for corner in itertools.product((0, 1), repeat=3):
        weight, word = (
            reduce(join, (sides[side][axis] for axis, side in enumerate(corner)))
            for join, sides in ((np.multiply, weights), (np.bitwise_xor, words))
        )
        mixed = _mixed(word, seed)
        kinds = np.uint64(len(_GRADIENTS))
        gradient = _GRADIENTS[mixed - mixed // kinds * kinds]  # a remainder, for which NumPy has no fast loop
        total += weight * np.einsum("pi,pi->p", gradient, offset - corner)
    return total * (2.0 / np.sqrt(3.0))


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


def _words(lattice: Int[ndarray, "points 3"]) -> tuple[tuple[ndarray, ndarray, ndarray], ...]:
    """Words of 64 bits for each coordinate of the lattice, at the lower and the upper side of each point's cell."""
    sides = ((lattice.view(np.uint64) * _PRIMES).T, ((lattice + 1).view(np.uint64) * _PRIMES).T)
    return tuple((x, (y << np.uint64(21)) ^ (y >> np.uint64(43)), z) for x, y, z in sides)


def _mixed(words: ndarray, seed: int) -> ndarray:
    """A 64-bit hash of each word (finaliser of SplitMix64; Steele et al. 2014)."""
    value = words + np.uint64((seed * 0x9E3779B97F4A7C15) % 2**64)
    value = (value ^ (value >> np.uint64(30))) * _MIX[0]
    value = (value ^ (value >> np.uint64(27))) * _MIX[1]
    return value ^ (value >> np.uint64(31))
