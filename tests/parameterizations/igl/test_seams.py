"""Surfaces of every topology are cut to a disk; further seams lower the stretch."""

import numpy as np
import pytest
from svbrdfgan_igl.cut_to_disk import ENOUGH, cut_to_disk, is_one_surface
from svbrdfgan_igl.energy import stretch
from svbrdfgan_igl.flatten import least_stretch
from svbrdfgan_igl.seams import SurfaceGraph, cut_open, opening
from svbrdfgan_igl.topology import components, euler, is_manifold

Surface = tuple[np.ndarray, np.ndarray]


def without(surface: Surface, chosen: list[int]) -> Surface:
    positions, faces = surface
    used, index = np.unique(np.delete(faces, chosen, axis=0), return_inverse=True)
    return positions[used], index.reshape(-1, 3)


def test_topology_is_counted(square: Surface, torus: Surface) -> None:
    assert euler(square[1]) == 1
    assert euler(torus[1]) == 0
    assert is_manifold(torus[1])
    assert not is_manifold(np.concatenate([square[1], square[1][:1]]))
    assert not is_manifold(np.array([[0, 1, 2], [0, 3, 4]]))  # two fans at a vertex
    assert components(np.array([[0, 1, 2], [0, 3, 4]]))[0] == 2


@pytest.mark.parametrize("holes", [[], [0], [0, 100], [0, 100, 200, 430]])
def test_handles_and_holes_are_cut_open(torus: Surface, holes: list[int]) -> None:
    positions, faces = without(torus, holes)
    net = SurfaceGraph.of(positions, faces)
    assert net.handles == 1
    assert len(net.loops) == len(holes)
    disk, source = cut_open(net, opening(net))
    assert disk.is_disk
    assert np.allclose(disk.positions, positions[source])
    assert (source[disk.faces] == faces).all()


def test_a_torus_is_cut_around_and_across_and_no_further(torus: Surface) -> None:
    """The shortest cut graph through a point: one loop around the tube, and one along it on the inner side."""
    net = SurfaceGraph.of(*torus)
    cut = opening(net)
    length = np.linalg.norm(net.positions[cut[:, 0]] - net.positions[cut[:, 1]], axis=1).sum()
    assert length < 1.5 * (2 * np.pi * 0.4 + 2 * np.pi * 1.0)


def test_a_square_with_holes_is_cut_between_them(square: Surface) -> None:
    net = SurfaceGraph.of(*without(square, [20, 45, 90]))
    assert net.handles == 0
    assert len(net.loops) == 4
    assert cut_open(net, opening(net))[0].is_disk


def test_closed_surfaces_are_cut_until_their_stretch_is_low(torus: Surface) -> None:
    few, many = (cut_to_disk(*torus, seams)[0] for seams in (0, None))
    assert stretch(many.positions, many.faces, least_stretch(many, "free", 0.004)) < ENOUGH + 0.02
    assert len(many.border) >= len(few.border)


def test_open_disks_are_left_whole_unless_told(square: Surface) -> None:
    assert len(cut_to_disk(*square, None)[0].positions) == len(square[0])
    assert len(cut_to_disk(*square, 1)[0].positions) > len(square[0])


def test_degenerate_and_broken_surfaces_are_not_one_surface(square: Surface) -> None:
    positions, faces = square
    assert is_one_surface(positions, faces)
    assert not is_one_surface(positions * (1, 1, 0), faces)
    assert not is_one_surface(positions, np.concatenate([faces, faces[:1, ::-1]]))
