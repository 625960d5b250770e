"""Cells hold what lies in them, and there are never many times more entries than triangles."""

import numpy as np
import pytest
from numpy import ndarray

from svbrdfgan.geometry.cells import MOST_CELLS, CellGrid

RIGHT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])


def scattered(count: int, size: float) -> ndarray:
    random = np.random.default_rng(3)
    return random.uniform(size=(count, 1, 2)) * (1.0 - size) + size * random.uniform(size=(count, 3, 2))


@pytest.mark.parametrize("side", [1, 7, 40.9, 1e9])
def test_a_triangle_is_entered_wherever_a_point_of_it_lies(side: float) -> None:
    corners = scattered(100, 0.2)
    grid = CellGrid.around(corners, side)
    triangle, cell = grid.entries(corners)
    entered = set(zip(triangle.tolist(), cell.tolist(), strict=True))
    assert grid.side == min(int(side), MOST_CELLS)
    assert len(entered) == len(triangle)
    weights = np.random.default_rng(4).dirichlet(np.ones(3), size=50)
    for k, points in enumerate(np.einsum("wk,tkx->twx", weights, corners)):
        assert {(k, place) for place in grid.cells(points).tolist()} <= entered


def test_points_outside_go_to_the_nearest_cell() -> None:
    grid = CellGrid.around(RIGHT[None], 4)
    assert grid.cells(np.array([[-9.0, -9.0], [9.0, -9.0], [9.0, 9.0], [0.6, 9.0]])).tolist() == [0, 3, 15, 14]


def test_a_few_large_triangles_among_small_ones_make_cells_larger() -> None:
    corners = np.concatenate([scattered(20_000, 1 / 256), np.tile(RIGHT, (40, 1, 1))])
    grid = CellGrid.around(corners, MOST_CELLS)
    assert len(grid.entries(corners)[0]) <= 8 * len(corners)
    assert grid.side >= 32


def test_triangles_that_all_fill_the_square_share_a_cell() -> None:
    corners = np.tile(RIGHT, (140_000, 1, 1))
    assert CellGrid.around(corners, MOST_CELLS).side <= 2


def test_overlaps_are_the_entries_that_a_triangle_itself_meets() -> None:
    """Slivers included: every cell with a point of the triangle, and few of the others in its box."""
    rng = np.random.default_rng(4)
    start, along = rng.random((200, 1, 2)), rng.normal(scale=0.3, size=(200, 1, 2))
    corners = np.concatenate([start, start + along, start + 0.5 * along + rng.normal(scale=0.003, size=(200, 1, 2))], 1)
    cells = CellGrid.around(corners, 40.0)
    found, boxed = (
        set(zip(*map(np.ndarray.tolist, e), strict=True)) for e in (cells.overlaps(corners), cells.entries(corners))
    )
    assert found <= boxed
    assert len(found) < 0.5 * len(boxed)
    weights = rng.dirichlet(np.ones(3), 3000)
    for triangle, points in enumerate(np.einsum("pk,tkx->tpx", weights, corners)):
        assert {(triangle, int(cell)) for cell in cells.cells(points)} <= found
