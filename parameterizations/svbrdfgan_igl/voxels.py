"""Turns a mesh into cubic cells, and these into one topological ball, for any holes, shells and interiors."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy import ndimage

PAD = 3
"""Empty cells on every side of the mesh, so that every cell's neighbourhood lies inside the grid."""

_EIGHT = np.ones((3, 3), dtype=bool)
_LOW = 0.45  # of the height: cells below parts of the mesh in this range are filled down to the ground
_OPEN = 0.25  # of 26 directions: a cell from which fewer are unblocked lies in a pocket, which is filled
_CLOSING = 0.04  # of the longest side: half the width of the notches that are closed in the outline on the ground

_ROD = 0.16  # a cell belongs to a rod if less than this share of the box around it is solid
_STUB = 2  # cells of a rod that are kept next to the body


@dataclass(frozen=True, eq=False)
class VoxelGrid:
    """Cubic cells around a mesh.

    Attributes:
        origin: centre of cell (0, 0, 0), metres.
        size: side of a cell, metres.
        shape: cells along x, y and z.
    """

    origin: Float[ndarray, " 3"]
    size: float
    shape: tuple[int, int, int]

    @classmethod
    def around(cls, bounds: Float[ndarray, "2 3"], cells: int) -> VoxelGrid:
        """The grid with `cells` along the longest side of a box, and `PAD` more on either side."""
        size = float((bounds[1] - bounds[0]).max()) / cells
        count = np.maximum(np.ceil((bounds[1] - bounds[0]) / size - 1e-6).astype(np.int64), 1)  # rounding adds no cell
        x, y, z = (int(n) + 2 * PAD for n in count)
        # not along y, where the mesh stands on the ground
        slack = (count * size - (bounds[1] - bounds[0])) / 2 * (1, 0, 1)
        return cls(bounds[0] - slack + (0.5 - PAD) * size, size, (x, y, z))


def near_cells(
    grid: VoxelGrid, positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]
) -> Bool[ndarray, "x y z"]:
    """Cells whose centre lies within one cell, along each axis, of a point of the mesh.

    These cells leave no gap through which an axis-parallel or diagonal ray could pass.
    """
    between = np.zeros(grid.shape, dtype=bool)
    for points in _samples(positions[faces], grid.size / 2):
        cell = np.floor((points - grid.origin) / grid.size).astype(np.int64)
        # samples lie between eight cell centres; the dilation below marks all eight
        between.ravel()[np.ravel_multi_index(tuple(cell.T), grid.shape, mode="clip")] = True
    return np.asarray(ndimage.binary_dilation(between, np.ones((2, 2, 2)), origin=-1))


def closed_cells(near: Bool[ndarray, "x y z"], grid: VoxelGrid, rods: int) -> Bool[ndarray, "x y z"]:
    """The cells that the wrap must hold: the mesh, pockets with low sky visibility, and the space under its lower part.

    The lowest layer is one patch without holes. Rods that fill little of a box of `rods` cells are left out.
    """
    keep = near | (_sky_visibility(near) < _OPEN)
    height = np.flatnonzero(near.any(axis=(0, 2)))
    low = height[0] + max(int(np.ceil(_LOW * len(height))), 1)
    outline = _one_patch(np.asarray(near[:, :low].any(axis=1)), round(_CLOSING * max(grid.shape)))
    top = np.where(near[:, :low], np.arange(low)[None, :, None], PAD).max(axis=1)
    column = np.arange(grid.shape[1])[None, :, None]
    keep |= outline[:, None, :] & (column <= top[:, None, :])
    keep[:, :PAD] = False
    return _without_rods(keep, rods)


def _without_rods(keep: Bool[ndarray, "x y z"], box: int) -> Bool[ndarray, "x y z"]:
    """The largest component of the cells after removing rods such as antennas, gun barrels and mirror stalks.

    Rods are removed because a one-to-one map of a disk shrinks their tips exponentially with their length.
    """
    filled = ndimage.uniform_filter(keep.astype(np.float64), box, mode="constant")
    thick = ndimage.binary_dilation(keep & (filled > _ROD), np.ones((3, 3, 3)), iterations=_STUB)
    label, count = ndimage.label(keep & thick, np.ones((3, 3, 3)))
    return np.asarray(label == 1 + np.argmax(np.bincount(label.ravel())[1:])) if count else keep


def filled_columns(keep: Bool[ndarray, "x y z"]) -> Bool[ndarray, "x y z"]:
    """A topological ball that holds these cells: over their filled outline, columns are solid up to their top cell."""
    outline = _one_patch(np.asarray(keep.any(axis=1)), 0)
    above = np.flip(np.logical_or.accumulate(np.flip(keep, axis=1), axis=1), axis=1)
    above[:, PAD] |= outline
    above[:, :PAD] = False
    return above & outline[:, None, :]


def _one_patch(outline: Bool[ndarray, "x z"], closing: int) -> Bool[ndarray, "x z"]:
    """The largest component of the outline, with its notches closed and its holes filled."""
    if closing:
        around = np.pad(outline, closing)
        far = ndimage.distance_transform_edt(~around) > closing
        outline = outline | (ndimage.distance_transform_edt(~far) > closing)[closing:-closing, closing:-closing]
    label, count = ndimage.label(outline, _EIGHT)
    if count > 1:
        outline = label == 1 + np.argmax(np.bincount(label.ravel())[1:])
    return np.asarray(ndimage.binary_fill_holes(outline))


def _sky_visibility(near: Bool[ndarray, "x y z"]) -> Float[ndarray, "x y z"]:
    """The share of 26 directions in which no cell of the mesh blocks the view; the ground does not block it."""
    free = np.zeros(near.shape)
    steps = [step for step in product((-1, 0, 1), repeat=3) if any(step)]
    for step in steps:
        free += ~_blocked(near, step)
    return free / len(steps)


def _blocked(near: Bool[ndarray, "x y z"], step: tuple[int, ...]) -> Bool[ndarray, "x y z"]:
    """Marks cells that hold the mesh or have a cell of the mesh further along a direction."""
    axis = next(k for k in range(3) if step[k])
    blocked = np.moveaxis(near.copy(), axis, 0)
    if step[axis] > 0:
        blocked = blocked[::-1]
    across = [step[k] for k in range(3) if k != axis]
    for k in range(1, len(blocked)):  # one sweep: a cell is blocked if the next one along the direction is
        blocked[k] |= _shifted(blocked[k - 1], across)
    return np.moveaxis(blocked[::-1] if step[axis] > 0 else blocked, 0, axis)


def _shifted(plane: Bool[ndarray, "a b"], step: list[int]) -> Bool[ndarray, "a b"]:
    """result[i] = plane[i + step], False outside the plane."""
    result = np.zeros_like(plane)
    into = tuple(slice(max(-s, 0), n - max(s, 0)) for s, n in zip(step, plane.shape, strict=True))
    source = tuple(slice(max(s, 0), n - max(-s, 0)) for s, n in zip(step, plane.shape, strict=True))
    result[into] = plane[source]
    return result


def _samples(corners: Float[ndarray, "faces 3 3"], spacing: float) -> list[Float[ndarray, "points 3"]]:
    """Points on a regular grid over each triangle, corners included, at most `spacing` apart along its edges."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    steps = np.maximum(np.ceil(longest / spacing).astype(np.int64), 1)
    # rounded up to powers of two, so that few groups of triangles are sampled alike
    steps = 1 << np.ceil(np.log2(steps)).astype(np.int64)
    found = []
    for count in np.unique(steps):
        i, j = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
        i, j = i[i + j <= count], j[i + j <= count]
        weights = np.stack([i, j, count - i - j], axis=1) / count
        found.append(np.einsum("pc,fcx->fpx", weights, corners[steps == count]).reshape(-1, 3))
    return found
