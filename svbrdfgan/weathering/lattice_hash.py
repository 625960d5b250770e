"""A hash of lattice points and the random numbers made from it, in NumPy; the kernels' hash is equal to the bit."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int, UInt64
from numpy import ndarray

PRIMES = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
MIX = (0xBF58476D1CE4E5B9, 0x94D049BB133111EB)

_GRADIENTS = np.array([v for v in itertools.product((-1, 0, 1), repeat=3) if np.abs(v).sum() == 2]) / np.sqrt(2.0)
DIRECTIONS: Float[ndarray, "3 12"] = np.ascontiguousarray(_GRADIENTS.T)
"""The twelve directions from a cube's centre to its edges (Perlin 2002), of unit length."""

_PRIMES = np.array(PRIMES, dtype=np.uint64)
_MIX = np.array(MIX, dtype=np.uint64)


def stream(number: int) -> int:
    """The word that makes all hashes of one number independent of those of another."""
    return (number * PRIMES[0]) % 2**64


def words(lattice: Int[ndarray, "3 points"]) -> tuple[ndarray, ndarray, ndarray]:
    """Words of 64 bits for each coordinate of lattice points."""
    x, y, z = lattice.view(np.uint64) * _PRIMES[:, None]
    return x, (y << np.uint64(21)) ^ (y >> np.uint64(43)), z


def hashed(words: Sequence[ndarray], number: int) -> UInt64[ndarray, "*shape"]:
    """A 64-bit hash of three words and a number (finaliser of SplitMix64; Steele et al. 2014)."""
    value = words[0] ^ words[1] ^ words[2]
    value += np.uint64(stream(number))
    return _finalised(value)


def next_hash(value: UInt64[ndarray, "*shape"]) -> UInt64[ndarray, "*shape"]:
    """A further hash, for a lattice point that needs more random numbers."""
    return _finalised(value + _PRIMES[0])


def _finalised(value: UInt64[ndarray, "*shape"]) -> UInt64[ndarray, "*shape"]:
    """In place."""
    value ^= value >> np.uint64(30)
    value *= _MIX[0]
    value ^= value >> np.uint64(27)
    value *= _MIX[1]
    value ^= value >> np.uint64(31)
    return value


def five_numbers(value: UInt64[ndarray, " points"]) -> Float[ndarray, "5 points"]:
    """Random numbers in [0, 1), of 12 bits each."""
    return np.stack([(value >> np.uint64(12 * place)) & np.uint64(0xFFF) for place in range(5)]) / 4096.0


def four_numbers(value: UInt64[ndarray, " points"]) -> Float[ndarray, "4 points"]:
    """Random numbers in [0, 1), of 16 bits each."""
    return np.stack([(value >> np.uint64(16 * place)) & np.uint64(0xFFFF) for place in range(4)]) / 65536.0
