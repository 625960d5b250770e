"""Searches for the lattice of the warp renderer's random numbers (`svbrdfgan_warp/rng.py`), and shows how even it is.

A picture takes the first 2^m points of the lattice in each pixel, m from 2 to 20. For each m and any two dimensions the
spectral test says how even these points lie: the length of the shortest vector of the dual lattice, over that of the
best lattice of as many points. The search adds a bit to all generators at a time, and keeps the best by the sum of
logarithms, in which the planes that light, rays and film are drawn in count eight times as much as others.

    python benchmarks/lattice.py [BEAM]
"""

from __future__ import annotations

import sys
from itertools import combinations, product

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

BITS = 20
DIMENSIONS = 6
PLANES = ((0, 1), (2, 3), (4, 5))
"""Film, emitter and BSDF."""
OTHERS = [pair for pair in combinations(range(DIMENSIONS), 2) if pair not in PLANES]
WEIGHT = 8.0
BEAM = 4000
BEFORE = np.array([[1, 182667, 469891, 498753, 110745, 446979]])
"""The lattice that the renderer had until 2026-11-29: Cools, Kuo and Nuyens (2006), made for 2^10 points and more."""


def evenness(bits: int) -> Float[ndarray, " generators"]:
    """How even 2^bits points (k, g k) are for each g; 0 for even g."""
    count = 1 << bits
    odd = np.arange(1, count, 2, dtype=np.int64)
    long = np.stack([np.full_like(odd, count), np.zeros_like(odd)], axis=1)
    short = np.stack([-odd, np.ones_like(odd)], axis=1)
    while True:  # Gauss's reduction of the dual lattice's basis
        swap = np.square(long).sum(axis=1, keepdims=True) < np.square(short).sum(axis=1, keepdims=True)
        long, short = np.where(swap, short, long), np.where(swap, long, short)
        times = np.rint((long * short).sum(axis=1) / np.square(short).sum(axis=1)).astype(np.int64)
        if not times.any():
            break
        long = long - times[:, None] * short
    found = np.zeros(count)
    found[odd] = np.sqrt(np.square(short).sum(axis=1) * np.sqrt(0.75) / count)
    return found


def of_plane(
    table: Float[ndarray, " generators"], generators: Int[ndarray, "lattices dimensions"], a: int, b: int
) -> Float[ndarray, " lattices"]:
    """How even the lattices are in the plane of two dimensions."""
    mask = len(table) - 1
    inverse = generators[:, a] & mask
    for _ in range(5):  # Newton's iteration doubles the bits that are right
        inverse = (inverse * (2 - (generators[:, a] & mask) * inverse)) & mask
    return table[(inverse * generators[:, b]) & mask]


def search(tables: dict[int, Float[ndarray, " generators"]], beam: int) -> Int[ndarray, "1 dimensions"]:
    """The best lattice found."""
    lattices, score = np.ones((1, DIMENSIONS), dtype=np.int64), np.zeros(1)
    added = np.array([(0, *bits) for bits in product((0, 1), repeat=DIMENSIONS - 1)])  # the first generator stays 1
    for bits, table in tables.items():
        lattices = (lattices[:, None] + added * (1 << (bits - 1))).reshape(-1, DIMENSIONS)
        score = np.repeat(score, len(added))
        for pairs, weight in ((PLANES, WEIGHT), (OTHERS, 1.0)):
            score += weight * sum(np.log(of_plane(table, lattices, *pair)) for pair in pairs)
        best = np.argsort(-score, kind="stable")[:beam]
        lattices, score = lattices[best], score[best]
    return lattices[:1]


def main() -> None:
    beam = int(sys.argv[1]) if len(sys.argv) > 1 else BEAM
    tables = {bits: evenness(bits) for bits in range(2, BITS + 1)}
    for name, lattice in (("before", BEFORE), ("found", search(tables, beam))):
        print(name, *lattice[0].tolist())
        for bits, table in tables.items():
            planes = ", ".join(f"{of_plane(table, lattice, *pair)[0]:.2f}" for pair in PLANES)
            least = min(of_plane(table, lattice, *pair)[0] for pair in OTHERS)
            print(f"  2^{bits:<3} film, emitter, BSDF: {planes}; least of the others: {least:.2f}")


if __name__ == "__main__":
    main()
