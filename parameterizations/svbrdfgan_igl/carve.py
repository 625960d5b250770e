"""Removes cells from a solid without changing its topology: homotopic thinning by simple points.

Solid cells are connected across faces and edges (18-connected), background cells across faces (6+), as in the surface
that marching cubes puts between them. A cell is simple, and its removal keeps the topology, if its neighbourhood holds
one component of solid (within two steps) and one of background (within three steps) (Bertrand 1994).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

_OFFSETS = np.array(list(product((-1, 0, 1), repeat=3)))


def _mask(chosen: Bool[ndarray, " 27"]) -> np.uint32:
    return np.uint32(sum(1 << int(k) for k in np.flatnonzero(chosen)))


_REACH = np.abs(_OFFSETS).sum(axis=1)
_N26 = _mask(_REACH > 0)  # neighbours across corners, edges and faces
_N18 = _mask((_REACH > 0) & (_REACH < 3))  # across edges and faces
_N6 = _mask((_REACH > 0) & (_REACH < 2))  # across faces
_AXES = [  # for each axis: shift of the bit index, cells with a neighbour below, cells with one above
    (np.uint32(9 // 3**k), _mask(_OFFSETS[:, k] > -1), _mask(_OFFSETS[:, k] < 1)) for k in range(3)
]

Codes = Int[ndarray, " cells"]


def carve(
    solid: Bool[ndarray, "x y z"], keep: Bool[ndarray, "x y z"], distance: Float[ndarray, "x y z"]
) -> Bool[ndarray, "x y z"]:
    """The solid after simple cells outside `keep` are removed, the most distant first; its topology stays the same.

    Every cell has 26 neighbours inside the grid: the outermost layers of the grid must be empty.
    """
    flat = solid.copy().ravel()
    offsets = _OFFSETS @ np.array([solid.shape[1] * solid.shape[2], solid.shape[2], 1])
    parity = _parity(solid.shape)
    left = np.flatnonzero((solid & ~keep).ravel())
    rank = np.ceil(distance.ravel()).astype(np.int64)
    for level in np.unique(rank[left])[::-1]:
        shell = left[(rank[left] >= level) & flat[left]]
        removed = True
        while removed:
            removed = _peel(flat, shell, parity, offsets)
            shell = shell[flat[shell]]
    return flat.reshape(solid.shape)


def _peel(flat: ndarray, cells: Int[ndarray, " cells"], parity: Int[ndarray, " all"], offsets: ndarray) -> bool:
    """Removes the simple cells, and returns whether any was removed.

    Cells of one parity class are never neighbours, so that removing all simple ones of a class at once is safe.
    """
    removed = False
    for kind in range(8):
        some = cells[parity[cells] == kind]
        code = np.zeros(len(some), dtype=np.uint32)
        for bit, offset in enumerate(offsets):
            code |= flat[some + offset].astype(np.uint32) << np.uint32(bit)
        gone = some[simple(code)]
        flat[gone] = False
        removed |= len(gone) > 0
    return removed


def simple(code: Codes) -> Bool[ndarray, " cells"]:
    """Whether each cell is simple, from the 27 bits of its neighbourhood (bit 9 (x+1) + 3 (y+1) + (z+1))."""
    solid, background = code & _N26, ~code & _N26
    first = solid & _N18
    near = first | (_grow18(first) & solid)
    seed = background & _N6
    around = seed | (_grow6(seed) & background & _N18)
    around |= _grow6(around) & background
    one_solid = (first != 0) & (_flood(_lowest(first), near, _grow18) == near)
    one_background = (seed != 0) & (seed & ~_flood(_lowest(seed), around, _grow6) == 0)
    return np.asarray(one_solid & one_background)


def _lowest(code: Codes) -> Codes:
    """The lowest set bit alone."""
    return code & (~code + np.uint32(1))


def _flood(start: Codes, within: Codes, grow: Callable[[Codes], Codes]) -> Codes:
    """The component of `within` that holds `start`, by repeated growth."""
    while True:
        more = grow(start) & within
        if np.array_equal(more, start):
            return start
        start = more


def _grow6(code: Codes) -> Codes:
    return code | _along(code, 0) | _along(code, 1) | _along(code, 2)


def _grow18(code: Codes) -> Codes:
    straight = [code | _along(code, axis) for axis in range(3)]
    return straight[0] | _along(straight[0], 1) | _along(straight[1], 2) | _along(straight[2], 0) | _grow6(code)


def _along(code: Codes, axis: int) -> Codes:
    """The neighbours of the set bits on both sides along an axis, without the set bits themselves."""
    shift, from_above, from_below = _AXES[axis]
    return ((code & from_above) >> shift) | ((code & from_below) << shift)


def _parity(shape: tuple[int, ...]) -> Int[ndarray, " all"]:
    """A class from 0 to 7 for each cell, by whether its indices along x, y and z are even or odd."""
    x, y, z = np.meshgrid(*(np.arange(n) % 2 for n in shape), indexing="ij")
    return np.asarray(4 * x + 2 * y + z).ravel()
