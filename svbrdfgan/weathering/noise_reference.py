"""The primitives of `procedural_noise` in NumPy float64: what the kernels are tested against, and used without Warp."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.utils.threads import by_blocks
from svbrdfgan.weathering.lattice_hash import DIRECTIONS, five_numbers, four_numbers, hashed, next_hash, words
from svbrdfgan.weathering.noise import gradient_noise

NUMBERS = 64
"""Hashed numbers of each seed: those from 0 are the octaves of `fbm`, and those below belong to the others."""
SPOTS, STREAKS, SCRATCHES = 61, 62, 63

MOST_BEND = 0.15
"""Of a scratch, at its ends, in half lengths."""
MOST_WIDTH = 0.05
"""Half the width of a scratch, in cells, up to which no part of it is cut off."""

_CORNERS = tuple(itertools.product((0, 1), repeat=3))
"""The lattice points nearest to a point. A centre is up to 0.5 from its own along each axis, so these have all shapes
whose centre is within 0.5 of the point."""
_COLUMNS, _ROWS = (-1, 0, 1), (-2, -1, 0)
"""The cells whose streaks may reach a point: these start within their cell, are at most 0.28 wide to either side, and
run down at most 1.25."""


def octave_weights(octaves: float, gain: float) -> list[float]:
    """The strength of each octave, the last one's by its fraction."""
    return [gain**octave * min(1.0, octaves - octave) for octave in range(math.ceil(octaves))]


def fbm(points: Float[ndarray, "points 3"], seed: int, octaves: float, gain: float, slope: bool) -> tuple[ndarray, ...]:
    """The value (points,) and, if `slope`, its gradient (points, 3)."""

    def evaluate(block: ndarray) -> ndarray:
        weights, total = octave_weights(octaves, gain), np.zeros((len(block), 4 if slope else 1))
        for octave, weight in enumerate(weights):
            place = block * 2.0**octave + np.array([0.37, 0.71, 0.13]) * (octave + 1)
            if slope:
                total += weight * _noise_and_slope(place, seed * NUMBERS + octave) * np.array([1, *3 * [2.0**octave]])
            else:
                total[:, 0] += weight * gradient_noise(place, seed * NUMBERS + octave)
        return total / sum(weights)

    return _columns(evaluate, (1, 3) if slope else (1,), points)


def _noise_and_slope(points: Float[ndarray, "points 3"], number: int) -> Float[ndarray, "points 4"]:
    """`gradient_noise`, and its derivatives."""
    cell = np.floor(points.T)
    near = points.T - cell
    high = near**3 * (near * (near * 6.0 - 15.0) + 10.0)
    steep = 30.0 * (near * (near - 1.0)) ** 2
    weights, slopes = (1.0 - high, high), (-steep, steep)
    total = np.zeros((4, len(points)))
    for corner in _CORNERS:
        side = np.array(corner)[:, None]
        kind = hashed(words(cell.astype(np.int64) + side), number) % np.uint64(12)
        toward = DIRECTIONS.take(kind.astype(np.int64), axis=1)
        value = np.einsum("ap,ap->p", toward, near - side)
        x, y, z = (weights[at][axis] for axis, at in enumerate(corner))
        dx, dy, dz = (slopes[at][axis] for axis, at in enumerate(corner))
        total[0] += x * y * z * value
        total[1:] += x * y * z * toward + np.stack([dx * y * z, x * dy * z, x * y * dz]) * value
    return total.T * (2.0 / np.sqrt(3.0))


def spots(
    points: Float[ndarray, "points 3"], share: Float[ndarray, " points"], seed: int, slope: bool
) -> tuple[ndarray, ...]:
    """Inside (points,), random (points, 4) and, if `slope`, the gradient of the first (points, 3)."""

    def evaluate(points: ndarray, share: ndarray) -> ndarray:
        cell = np.floor(points.T)
        inside, best, steep = np.zeros(len(points)), np.zeros(len(points), np.uint64), np.zeros((3, len(points)))
        for corner in _CORNERS:
            side = np.array(corner)[:, None]
            key = hashed(words(cell.astype(np.int64) + side), seed * NUMBERS + SPOTS)
            *jitter, size, order = five_numbers(key)
            radius = (0.125 + 0.375 * size) * _smoothstep((share - order) / 0.05)
            offset = points.T - cell - side - (np.stack(jitter) - 0.5)
            distance = np.sqrt((offset**2).sum(axis=0))
            deeper = radius * (1.0 - inside) > distance
            inside = np.where(deeper, 1.0 - distance / np.where(deeper, radius, 1.0), inside)
            best = np.where(deeper, key, best)
            steep = np.where(deeper, -offset / np.where(deeper & (distance > 0.0), distance * radius, np.inf), steep)
        random = four_numbers(next_hash(best)) * (inside > 0.0)
        return np.stack([inside, *random, *(steep if slope else ())], axis=1)

    return _columns(evaluate, (1, 4, 3) if slope else (1, 4), points, share)


def streaks(plane: Float[ndarray, "points 2"], share: Float[ndarray, " points"], seed: int) -> tuple[ndarray, ...]:
    """Strength (points,), along (points,), head (points, 2) and random (points, 4)."""

    def evaluate(plane: ndarray, share: ndarray) -> ndarray:
        cell, count = np.floor(plane.T), len(plane)
        best, found = np.zeros(count, np.uint64), np.zeros((4, count))
        for row, column in itertools.product(_ROWS, _COLUMNS):
            place = cell.astype(np.int64) + np.array([[column], [row]])
            key = hashed(words(np.stack([*place, np.zeros(count, np.int64)])), seed * NUMBERS + STREAKS)
            across, down, length, width, order = five_numbers(key)
            head = np.stack([column + across, row + down]) - (plane.T - cell)
            t = -head[1] / (0.35 + 0.9 * length**2)
            a = head[0] / ((0.06 + 0.22 * width) * (1.0 - 0.5 * np.clip(t, 0.0, 1.0)))
            profile = np.maximum(0.0, 1.0 - a**2) * np.clip(1.0 - t, 0.0, 1.0) ** 1.2 * _smoothstep(t / 0.06)
            strength = profile * _smoothstep((share - order) / 0.1)
            stronger = strength > found[0]
            found = np.where(stronger, [strength, t, *head], found)
            best = np.where(stronger, key, best)
        random = four_numbers(next_hash(best)) * (found[0] > 0.0)
        return np.concatenate([found, random]).T

    return _columns(evaluate, (1, 1, 2, 4), plane, share)


def scratches(
    points: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"], share: Float[ndarray, " points"], seed: int
) -> tuple[ndarray, ...]:
    """Across, along and weight, each (points,), and random (points, 4)."""

    def evaluate(points: ndarray, normal: ndarray, share: ndarray) -> ndarray:
        cell, count = np.floor(points.T), len(points)
        best, found = (
            np.zeros(count, np.uint64),
            np.stack([np.full(count, MOST_WIDTH), np.zeros(count), np.zeros(count)]),
        )
        rank = np.full(count, 1e30)
        for corner in _CORNERS:
            side = np.array(corner)[:, None]
            key = hashed(words(cell.astype(np.int64) + side), seed * NUMBERS + SCRATCHES)
            *jitter, size, order = five_numbers(key)
            offset = points.T - cell - side - (np.stack(jitter) - 0.5)
            across, along, weight = _scratch(offset, normal.T, 0.06 + 0.34 * size**2, next_hash(key))
            weight *= _smoothstep((share - order) / 0.1)
            nearer = (across < MOST_WIDTH) & (across < rank * weight)
            rank = np.where(nearer, across / np.where(nearer, weight, 1.0), rank)
            found = np.where(nearer, [across, along, weight], found)
            best = np.where(nearer, key, best)
        random = four_numbers(next_hash(next_hash(best))) * (found[2] > 0.0)
        return np.concatenate([found, random]).T

    return _columns(evaluate, (1, 1, 1, 4), points, normal, share)


def _scratch(
    offset: Float[ndarray, "3 points"],
    normal: Float[ndarray, "3 points"],
    half: Float[ndarray, " points"],
    key: ndarray,
) -> tuple[ndarray, ndarray, ndarray]:
    """Distance, place along, and weight of one scratch at each point.

    The depth at which it ends is such that its centre is within 0.5 of all points where it weighs anything and is
    nearer than `MOST_WIDTH`.

    Args:
        offset: of the points from the scratch's centre.
        half: half the scratch's length.
        key: hash for its direction and bend.
    """
    height, turn, bend, _ = four_numbers(key)
    ring = np.sqrt(np.maximum(0.0, 1.0 - (2.0 * height - 1.0) ** 2))
    direction = np.stack([ring * np.cos(math.tau * turn), ring * np.sin(math.tau * turn), 2.0 * height - 1.0])
    toward = direction - normal * (normal * direction).sum(axis=0)
    length = np.sqrt((toward**2).sum(axis=0))
    toward /= np.maximum(length, 0.3)
    depth = (normal * offset).sum(axis=0)
    s = (offset * toward).sum(axis=0)
    inner = np.clip(s, -half, half)
    side = (offset * np.cross(normal, toward, axis=0)).sum(axis=0) - MOST_BEND * (2.0 * bend - 1.0) * inner**2 / half
    deepest = 0.25 - (half * math.hypot(1.0, MOST_BEND) + MOST_WIDTH) ** 2
    weight = np.maximum(0.0, 1.0 - depth**2 / deepest) * _smoothstep((length - 0.3) / 0.2)
    return np.hypot(s - inner, side), inner / half, weight


def _smoothstep(t: ndarray) -> ndarray:
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def _columns(evaluate: Callable[..., ndarray], widths: tuple[int, ...], *arrays: ndarray) -> tuple[ndarray, ...]:
    """The columns that `evaluate` returns for each block, as arrays of these widths; those of width 1 are flat."""
    found = by_blocks(evaluate, *arrays, shape=(sum(widths),))
    parts = np.split(found, np.cumsum(widths)[:-1], axis=1)
    return tuple(part[:, 0] if part.shape[1] == 1 else part for part in parts)
