"""Whatever the mesh, the solid around it is one ball, and carving keeps it one."""

import numpy as np
import pytest
from scipy import ndimage
from svbrdfgan_igl.carve import carve, simple
from svbrdfgan_igl.topology import components, euler, is_manifold
from svbrdfgan_igl.voxels import VoxelGrid, closed_cells, filled_columns, near_cells
from svbrdfgan_igl.wrap import _boundary

ALL = np.ones((3, 3, 3), dtype=bool)


def surface_of(cells: np.ndarray) -> tuple[int, int]:
    """Components and Euler characteristic of the surface around cells."""
    _, faces = _boundary(np.pad(cells, 2), VoxelGrid(np.zeros(3), 1.0, tuple(n + 4 for n in cells.shape)))
    return (components(faces)[0], euler(faces)) if len(faces) else (0, 0)


def test_simple_cells_are_those_whose_removal_keeps_the_surface() -> None:
    """Of random neighbourhoods: what is called simple changes neither components nor genus of the surface."""
    rng = np.random.default_rng(0)
    around = rng.random((400, 3, 3, 3)) < rng.uniform(0.1, 0.9, (400, 1, 1, 1))
    called = simple((around.reshape(-1, 27) @ (1 << np.arange(27))).astype(np.uint32))
    assert 20 < called.sum() < 380
    for cells, is_simple in zip(around, called, strict=True):
        whole, less = cells.copy(), cells.copy()
        whole[1, 1, 1], less[1, 1, 1] = True, False
        if is_simple:
            assert surface_of(whole) == surface_of(less)
        elif surface_of(whole) == surface_of(less):
            assert cells.sum() > 1  # what changes cancels, as a piece joined and a handle closed


@pytest.mark.parametrize("seed", range(4))
def test_carving_keeps_the_topology_of_a_ball(seed: int) -> None:
    """Blobs with handles, cavities and loose pieces: what is left around them has one sphere for a surface."""
    rng = np.random.default_rng(seed)
    noise = ndimage.gaussian_filter(rng.normal(size=(24, 20, 22)), 1.5)
    keep = np.zeros((30, 26, 28), dtype=bool)
    keep[3:-3, 3:-3, 3:-3] = noise > np.quantile(noise, 0.75)
    solid = np.zeros_like(keep)
    solid[3:-3, 3:-3, 3:-3] = True
    carved = carve(solid, keep, ndimage.distance_transform_edt(~keep))
    assert (carved | ~keep).all()
    assert carved.sum() < solid.sum()
    _, faces = _boundary(carved, VoxelGrid(np.zeros(3), 1.0, carved.shape))
    assert is_manifold(faces)
    assert components(faces)[0] == 1
    assert euler(faces) == 2


def test_no_ray_slips_through_a_thin_sheet() -> None:
    """A slanted triangle's cells part the two sides of the grid for every one of the 26 directions."""
    corners = np.array([[-5.0, 0.1, -5.0], [5.0, 0.4, -5.0], [0.0, 0.2, 9.0]])
    grid = VoxelGrid.around(np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]]), 12)
    inside = near_cells(grid, corners, np.array([[0, 1, 2]]))[4:-4, :, 4:-4]
    label, count = ndimage.label(~inside, ALL)
    assert count == 2
    assert label[0, 0, 0] != label[0, -1, 0]


def test_gaps_near_the_ground_are_filled_and_rods_left_out() -> None:
    near = np.zeros((26, 26, 46), dtype=bool)
    near[3:23, 6:15, 3:43] = True
    near[3:5, 3:6, 5:8] = near[20:23, 3:6, 35:40] = True  # two feet
    near[12:14, 15:23, 20:22] = True  # an antenna
    keep = closed_cells(near, VoxelGrid(np.zeros(3), 1.0, near.shape), 9)
    assert keep[5:20, 3:6, 8:38].all()
    assert not keep[:, 20:].any()
    assert filled_columns(keep)[keep].all()
