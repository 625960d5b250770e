"""Mirrored and overlapping area, coverage, seams and charts, where they are known."""

import numpy as np
import pytest
from known_maps import cylinder, flat, grid, sheet, surface_of

from svbrdfgan.metrics.uv.layout import layout
from svbrdfgan.metrics.uv.visibility import whole_surface
from svbrdfgan.types import Surface

TRIANGLE = np.array([[0.1, 0.1], [0.5, 0.1], [0.1, 0.5]])


def two_triangles(offset: tuple[float, float], apart: float = 1.0) -> Surface:
    """Two equal triangles, `apart` metres from each other, the second moved by `offset` in the map."""
    space = np.column_stack([TRIANGLE, np.zeros(3)])
    positions = np.concatenate([space, space + np.array([0, 0, apart])])
    return surface_of(positions, [[0, 1, 2], [3, 4, 5]], np.concatenate([TRIANGLE, TRIANGLE + offset]))


def test_a_plane_is_one_chart_without_fault() -> None:
    found = layout(whole_surface(sheet(flat(2.0, 2.0))))
    assert (found.flipped, found.overlapping, found.seam_length, found.charts) == (0.0, 0.0, 0.0, 1)
    assert found.coverage == 1.0


def test_coverage_is_the_area_in_the_square() -> None:
    found = layout(whole_surface(sheet(flat(1.0, 1.0), uv=lambda st: 0.25 + 0.5 * st)))
    assert found.coverage == pytest.approx(0.25, abs=1e-9)
    assert layout(whole_surface(two_triangles((0.4, 0.4)))).coverage == pytest.approx(0.16, rel=0.01)


@pytest.mark.parametrize(
    ("offset", "share"),
    [((0.0, 0.0), 1.0), ((0.2, 0.0), 0.25), ((0.1, 0.1), 0.25), ((0.4, 0.0), 0.0), ((0.4, 0.4), 0.0)],
)
def test_two_triangles_overlap_by_what_they_share(offset: tuple[float, float], share: float) -> None:
    """What two such triangles share is one of (0.4 - dx - dy) on a side."""
    assert layout(whole_surface(two_triangles(offset))).overlapping == pytest.approx(share, abs=0.01)


def test_layers_that_lie_on_each_other_do_not_overlap() -> None:
    assert layout(whole_surface(two_triangles((0.0, 0.0), apart=1e-4))).overlapping == 0.0


def test_neighbours_do_not_overlap_where_they_touch() -> None:
    """Edges through the very centres of texels belong to both sides."""
    texel = 1 / 512
    surface = sheet(flat(1.0, 1.0), uv=lambda st: 0.5 * texel + (1 - texel) * st)
    assert layout(whole_surface(surface)).overlapping == 0.0


def test_a_fold_overlaps_and_is_flipped() -> None:
    """Two thirds of the strip lie on each other; its middle third runs backward."""
    s = np.array([0.0, 1.0, 0.0, 1.0]) * 0.5 + 0.1
    positions = np.array([[x, y, 0.0] for y in (0.0, 1.0) for x in range(4)])
    faces = [[a, b, c] for x in range(3) for a, b, c in ((x, x + 1, x + 5), (x, x + 5, x + 4))]
    uv = np.column_stack([np.tile(s, 2), np.repeat([0.0, 1.0], 4)])
    found = layout(whole_surface(surface_of(positions, faces, uv)))
    assert found.flipped == pytest.approx(1 / 3)
    assert found.overlapping == pytest.approx(1.0, abs=0.02)
    assert found.coverage == pytest.approx(0.5, abs=0.01)


def test_half_mirrored() -> None:
    positions = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [4, 0, 0], [3, 1, 0]]
    uv = np.array([[0, 0], [0.4, 0], [0, 0.4], [0.9, 0.5], [0.5, 0.5], [0.9, 0.9]])
    found = layout(whole_surface(surface_of(positions, [[0, 1, 2], [3, 4, 5]], uv)))
    assert (found.flipped, found.overlapping, found.charts) == (0.5, 0.0, 2)


def test_the_seam_of_a_cylinder_is_its_height() -> None:
    surface = sheet(cylinder(1.0, 3.0), 24, 4)
    area = 24 * 2 * np.sin(np.pi / 24) * 3.0
    found = layout(whole_surface(surface))
    assert found.seam_length == pytest.approx(3.0 / np.sqrt(area))
    assert found.charts == 1


def test_a_map_that_repeats_has_no_seam() -> None:
    found = layout(whole_surface(sheet(cylinder(1.0, 3.0), 24, 4, repeat=(True, False))))
    assert found.seam_length == 0.0


def test_every_face_a_chart_of_its_own() -> None:
    """A square of n x n squares has 2 n (n - 1) inner edges of 1 / n, and n^2 diagonals."""
    st, faces = grid(4, 4)
    small = st[faces] * 0.2 + np.random.default_rng(0).permutation(len(faces))[:, None, None] * (0.02, 0.02)
    found = layout(whole_surface(surface_of(flat(1.0, 1.0)(st), faces, small)))
    assert found.charts == 32
    assert found.seam_length == pytest.approx(2 * 4 * 3 / 4 + 16 * np.sqrt(2) / 4)


def test_an_edge_of_three_faces_is_one_seam() -> None:
    positions = [[0, 0, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0], [0, 0, 1]]
    uv = np.array([[[0, 0], [0, 0.2], [0.2, 0]], [[0, 0], [0, 0.2], [0.2, 0]], [[0.5, 0.5], [0.5, 0.7], [0.7, 0.5]]])
    found = layout(whole_surface(surface_of(positions, [[0, 1, 2], [0, 1, 3], [0, 1, 4]], uv)))
    assert found.seam_length == pytest.approx(1.0 / np.sqrt(1.5))
    assert found.charts == 2
