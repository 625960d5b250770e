"""The crease rule: flat things stay flat, round things stay round, bad triangles do no harm."""

import numpy as np
import pytest
import trimesh

from svbrdfgan.geometry import normals
from svbrdfgan.geometry.normals import corner_normals, face_areas, face_normals


def test_cube_stays_flat() -> None:
    cube = trimesh.creation.box()
    found = corner_normals(cube.vertices, cube.faces)
    assert np.allclose(found, face_normals(cube.vertices, cube.faces)[:, None, :])


def test_fine_sphere_is_radial() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=3)
    assert np.allclose(corner_normals(sphere.vertices, sphere.faces), sphere.vertices[sphere.faces], atol=0.01)


@pytest.mark.parametrize(("fold_degrees", "smooth"), [(38.0, True), (42.0, False)])
def test_folds_are_smooth_up_to_forty_degrees(fold_degrees: float, smooth: bool) -> None:
    fold = np.radians(fold_degrees)
    positions = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 0], [-np.cos(fold), -np.sin(fold), 0]])
    faces = np.array([[0, 1, 2], [0, 3, 1]])
    found = corner_normals(positions, faces)
    assert np.allclose(found[0, 0], found[1, 0]) == smooth
    assert np.allclose(found[0, 2], [0, 1, 0])


def test_corners_weigh_by_their_angle_and_not_by_how_they_are_cut() -> None:
    positions = np.array([[0, 0, 0], [0, 0, 1.0], [1, 0, 0], [-0.9, -0.4, 0], [0.5, 0, 0.5]])
    whole = corner_normals(positions, np.array([[0, 1, 2], [0, 3, 1]]))
    cut = corner_normals(positions, np.array([[0, 1, 4], [0, 4, 2], [0, 3, 1]]))
    assert np.allclose(whole[0, 0], cut[0, 0])


def test_degenerate_and_opposite_faces_are_harmless() -> None:
    positions = np.array([[0, 0, 0], [0, 0, 1.0], [1, 0, 0], [0.5, 0, 0.5], [0, 0, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 1], [0, 1, 2], [1, 3, 2], [0, 0, 1], [0, 4, 0]])
    found = corner_normals(positions, faces)
    assert np.allclose(np.linalg.norm(found, axis=2), 1)
    assert np.allclose(found[0], [0, 1, 0])
    assert np.allclose(found[1], [0, -1, 0])


def test_vertices_of_thousands_of_faces_are_smoothed_as_others(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    positions, faces = rng.normal(size=(12, 3)), np.sort(rng.integers(0, 12, (2000, 3)), axis=1)
    crowded = corner_normals(positions, faces)
    monkeypatch.setattr(normals, "_CROWD", 10_000)
    assert np.allclose(crowded, corner_normals(positions, faces), rtol=0.0, atol=1e-12)


@pytest.mark.timeout(60)
def test_a_face_that_is_there_thirty_thousand_times_takes_no_minutes() -> None:
    positions, faces = np.array([[0, 0, 0], [0, 0, 1.0], [1, 0, 0]]), np.tile([0, 1, 2], (30_000, 1))
    assert np.allclose(corner_normals(positions, faces), [0, 1, 0])


def test_area_of_a_unit_box_is_six() -> None:
    cube = trimesh.creation.box()
    assert np.isclose(face_areas(cube.vertices, cube.faces).sum(), 6)
