"""Connectivity and similarity where they are known."""

from dataclasses import replace

import numpy as np
import pytest
from known_maps import cylinder, dome, flat, grid, sheet, surface_of

from svbrdfgan.metrics.uv.neighbours import PROBES, REACH, connectivity, similarity, spread
from svbrdfgan.metrics.uv.summary import UVSummary
from svbrdfgan.metrics.uv.visibility import visible_surface, whole_surface


def test_a_plane_keeps_all_neighbours() -> None:
    assert connectivity(whole_surface(sheet(flat(1.0, 1.0)))) == 1.0


def test_a_seam_parts_the_pairs_that_cross_it() -> None:
    """Pairs lie within a disc of radius r: over a seam on a girth W, E|dx| / W = 4 r / (3 pi W) of them cross."""
    perimeter, area = 64 * 2 * np.sin(np.pi / 64), 64 * 2 * np.sin(np.pi / 64) * 3.0
    found = connectivity(whole_surface(sheet(cylinder(1.0, 3.0), 64, 8)))
    assert 1 - found == pytest.approx(4 * REACH * np.sqrt(area) / (3 * np.pi * perimeter), rel=0.1)
    assert connectivity(whole_surface(sheet(cylinder(1.0, 3.0), 64, 8, repeat=(True, False)))) == 1.0


def test_scattered_charts_keep_few() -> None:
    st, faces = grid(64, 64)
    cell = np.random.default_rng(0).permutation(len(faces))
    offset = np.stack([cell % 91, cell // 91], axis=1)[:, None] / 91
    found = connectivity(
        whole_surface(surface_of(flat(1.0, 1.0)(st), faces, (st[faces] - st[faces][:, :1]) * 0.5 + offset))
    )
    assert found < 0.4


def test_the_two_sides_of_a_sheet_are_no_neighbours() -> None:
    st, faces = grid(8, 8)
    positions = np.concatenate([flat(1.0, 1.0)(st), flat(1.0, 1.0)(st) - (0, 0, 1e-3)])
    both = np.concatenate([faces, faces[:, ::-1] + len(st)])
    uv = np.concatenate([st * (0.5, 1), st * (0.5, 1) + (0.5, 0)])
    assert connectivity(whole_surface(surface_of(positions, both, uv))) == 1.0


def test_samples_are_spread_by_area() -> None:
    surface = sheet(lambda st: flat(1.0, 1.0)(st**2), 16, 16)
    samples = spread(whole_surface(surface), PROBES)
    counts = np.histogram2d(*samples.positions[:, :2].T, bins=4, range=[[0, 1], [0, 1]])[0]
    np.testing.assert_allclose(counts, PROBES / 16, rtol=0.15)
    np.testing.assert_allclose(samples.uv**2, samples.positions[:, :2], atol=0.005)


def test_a_map_is_like_itself_whatever_the_size() -> None:
    surface = sheet(dome, 48, 48)
    stretched = replace(surface, positions=surface.positions * (0.9, 0.7, 2.1) + (3, 0, 1))
    for other in (surface, stretched):
        found = similarity(whole_surface(surface), whole_surface(other))
        assert found.mean < 2e-3
        assert found.matched > 0.99


def test_a_moved_map_is_as_far_away_as_it_was_moved() -> None:
    one = sheet(dome, 48, 48, uv=lambda st: 0.8 * st)
    other = sheet(dome, 48, 48, uv=lambda st: 0.8 * st + (0.03, 0.04))
    found = similarity(whole_surface(one), whole_surface(other))
    assert found.mean == pytest.approx(0.05, abs=1e-3)
    assert found.p90 == pytest.approx(0.05, abs=2e-3)
    assert similarity(whole_surface(other), whole_surface(one)) == found


def test_distance_goes_around_where_the_map_repeats() -> None:
    one, other = (
        sheet(flat(1.0, 1.0), 4, 4, uv=lambda st, low=low: st * (0.0, 1.0) + (low, 0.0), repeat=(True, False))
        for low in (0.02, 0.97)
    )
    assert similarity(whole_surface(one), whole_surface(other)).mean == pytest.approx(0.05, abs=1e-6)


def test_normals_decide_which_side_is_meant() -> None:
    """The front of a thin slab is matched with the front of a thinner one, not with the closer back."""
    st, faces = grid(8, 8)

    def slab(thickness: float, lip: float) -> np.ndarray:
        return np.concatenate([flat(1.0, 1.0)(st) + np.array([0, 0, z]) for z in (lip, lip - thickness)])

    both = np.concatenate([faces, faces[:, ::-1] + len(st)])
    uv = np.concatenate([st * (0.5, 1), st * (0.5, 1) + (0.5, 0)])
    frame = np.array([[0, 0, -1.0], [0, 0, 1.0], [0, 0.01, 1.0]])  # the same box around both
    all_faces = np.concatenate([both, [[2 * len(st), 2 * len(st) + 1, 2 * len(st) + 2]]])
    all_uv = np.concatenate([uv, np.zeros((3, 2))])
    one, other = (
        whole_surface(surface_of(np.concatenate([slab(0.1, lip), frame]), all_faces, all_uv)) for lip in (0.0, 0.09)
    )
    assert similarity(one, other).mean < 0.02


def test_nothing_alike_has_no_number() -> None:
    up = sheet(lambda st: np.column_stack([st[:, 0], 0 * st[:, 0], -st[:, 1]]))
    down = sheet(lambda st: np.column_stack([st[:, 0], 0 * st[:, 0], st[:, 1]]))
    found = similarity(whole_surface(up), whole_surface(down))
    assert (np.isnan(found.mean), found.matched) == (True, 0.0)


def test_the_card_holds_every_measure() -> None:
    summary = UVSummary.of(visible_surface(sheet(dome, 48, 48))).flat()
    assert summary["stretch_l2"] == pytest.approx(np.sqrt(5 * np.pi / 12), rel=0.02)
    assert summary["area"] == pytest.approx(2 * np.pi, rel=0.01)
    assert summary["coverage"] == pytest.approx(
        1 - 1 / 48, abs=1e-3
    )  # less the triangles that are a point, at the poles
    assert (summary["flipped"], summary["overlapping"], summary["kept"]) == (0.0, 0.0, 1.0)
    assert 0.99 < summary["connectivity"] < 1.0  # at the poles points of one place lie far apart
    assert summary["seen"] == pytest.approx(1.0, abs=0.01)
    assert all(type(value) in (float, int) for value in summary.values())
