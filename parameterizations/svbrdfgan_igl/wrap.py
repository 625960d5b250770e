"""Wraps a mesh of any number of shells in one disk, which is open at the ground and lies close to the mesh."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy import ndimage, sparse

from svbrdfgan.errors import EmbeddingError
from svbrdfgan_igl.carve import carve
from svbrdfgan_igl.topology import Disk, compact, largest_component
from svbrdfgan_igl.tutte import MILD, mildness
from svbrdfgan_igl.voxels import VoxelGrid, closed_cells, filled_columns, near_cells

# of the longest side: sizes of the box by which `closed_cells` finds rods, tried until Tutte's map is mild (`MILD`)
_RODS = (0.15, 0.25, 0.35)
_ROUNDS = 12  # of pulling towards the mesh and smoothing
_PULL = 0.5  # of the way to the mesh, in each round
_REACH = 1.8  # cells: wrap vertices further than this from the mesh bridge a gap and are not pulled


def wrap(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], cells: int, target_faces: int
) -> Disk:
    """A disk around the mesh, of about `target_faces` faces, whose border lies on the ground around the mesh.

    Args:
        cells: voxels along the mesh's longest side. Gaps narrower than a few of these are bridged.

    Raises:
        EmbeddingError: no disk can be wrapped around the mesh.
    """
    grid = VoxelGrid.around(np.stack([positions.min(axis=0), positions.max(axis=0)]), cells)
    near = near_cells(grid, positions, faces)
    found: list[tuple[float, Disk]] = []
    for rods in _RODS:
        solid = _solid(near, grid, rods)
        disk = _settled(_opened(*_boundary(solid, grid)), positions, faces, grid.size)
        disk = _settled(_decimated(disk, target_faces), positions, faces, grid.size, rounds=2)
        if not disk.is_disk:
            raise EmbeddingError("the mesh has no outer surface that could be wrapped; it is too thin or too ragged.")
        found.append((mildness(disk), disk))
        if found[-1][0] > MILD:
            break
    return max(found, key=lambda pair: pair[0])[1]


def _solid(near: Bool[ndarray, "x y z"], grid: VoxelGrid, rods: float) -> Bool[ndarray, "x y z"]:
    """A topological ball of cells that holds the mesh without its rods."""
    keep = closed_cells(near, grid, round(rods * max(grid.shape)) | 1)
    if not keep.any():
        raise EmbeddingError("the mesh has no outer surface that could be wrapped: it is too thin.")
    return carve(filled_columns(keep), keep, ndimage.distance_transform_edt(~keep))


def _boundary(solid: Bool[ndarray, "x y z"], grid: VoxelGrid) -> tuple[Float[ndarray, "v 3"], Int[ndarray, "f 3"]]:
    """The surface between solid and empty cells: closed, manifold, with the topology of the solid."""
    x, y, z = (grid.origin[k] + grid.size * np.arange(grid.shape[k]) for k in range(3))
    centres = np.stack([a.ravel() for a in np.meshgrid(x, y, z, indexing="ij")], axis=1)
    order = np.arange(solid.size).reshape(solid.shape).transpose(2, 1, 0).ravel()  # libigl wants x to vary fastest
    outside = np.where(solid.ravel(), -0.5, 0.5)[order]
    found = igl.marching_cubes(outside, np.ascontiguousarray(centres[order]), *grid.shape, 0.0)
    return found[0], found[1].astype(np.int64)


def _opened(positions: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"]) -> Disk:
    """A closed surface with its flat bottom removed."""
    low = positions[:, 1].min()
    flat = (positions[faces, 1] < low + 1e-9 * np.ptp(positions[:, 1])).all(axis=1)
    bottom = largest_component(faces, flat)
    return compact(positions, faces[largest_component(faces, ~bottom)])


def _settled(
    disk: Disk, positions: Float[ndarray, "v 3"], faces: Int[ndarray, "f 3"], cell: float, rounds: int = _ROUNDS
) -> Disk:
    """The disk after rounds of pulling it towards the mesh and smoothing it. Border vertices keep their height."""
    moved = disk.positions.copy()
    average = _average(disk)
    border = disk.border
    ground = moved[border, 1].copy()
    tree = igl.AABB()
    tree.init(positions, faces)
    for _ in range(rounds):
        squared, _, nearest = tree.squared_distance(positions, faces, moved)
        pull = np.where(squared < (_REACH * cell) ** 2, _PULL, 0.0)[:, None]
        moved = moved + pull * (nearest - moved)
        moved = average @ moved
        moved[border, 1] = ground
    return Disk(moved, disk.faces)


def _average(disk: Disk) -> sparse.csr_matrix:
    """Matrix of one smoothing step: half of a vertex plus half of its neighbours' mean.

    Border vertices have only border vertices as neighbours, so that the surface does not draw the border inwards.
    """
    count = len(disk.positions)
    edges = np.concatenate([disk.faces[:, [0, 1]], disk.faces[:, [1, 2]], disk.faces[:, [2, 0]]])
    row, col = np.concatenate([edges, edges[:, ::-1]]).T
    on_border = np.zeros(count, dtype=bool)
    on_border[disk.border] = True
    inner = ~on_border[row]
    loop = disk.border
    row = np.concatenate([row[inner], loop, loop])
    col = np.concatenate([col[inner], np.roll(loop, 1), np.roll(loop, -1)])
    links = sparse.csr_matrix((np.ones(len(row)), (row, col)), shape=(count, count))
    links.data[:] = 1.0  # inner edges were entered once for each of their two faces
    degree = np.asarray(links.sum(axis=1)).ravel()
    return (sparse.eye(count) + sparse.diags(1.0 / np.maximum(degree, 1.0)) @ links).tocsr() / 2


def _decimated(disk: Disk, target_faces: int) -> Disk:
    if len(disk.faces) <= target_faces:
        return disk
    found = igl.decimate(disk.positions, disk.faces, target_faces)
    vertices, faces = [part for part in found if getattr(part, "ndim", 0) == 2][:2]
    return compact(vertices, faces.astype(np.int64))
