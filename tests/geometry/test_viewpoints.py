"""`find_viewpoints`: where close-ups are taken from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.geometry.viewpoints import TILT_DEGREES, find_viewpoints
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.types import Mesh, Part

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])


def squares(*heights: float, alpha: float = 1.0, flipped: bool = False) -> Mesh:
    """Squares above each other that face up, or down, each its own part; the upper ones are wider, with that alpha."""
    middle = np.array([0.5, 0.0, 0.5])
    wide = [SQUARE if not number else middle + 3.0 * (SQUARE - middle) for number in range(len(heights))]
    positions = np.concatenate(
        [flat + np.array([0.0, height, 0.0]) for flat, height in zip(wide, heights, strict=True)]
    )
    first = np.array([[0, 1, 2], [0, 2, 3]] if flipped else [[0, 2, 1], [0, 3, 2]])
    faces = np.concatenate([first + 4 * number for number in range(len(heights))])
    parts = tuple(Part(f"part{number}", alpha=alpha if number else 1.0) for number in range(len(heights)))
    return Mesh(positions, faces, np.repeat(np.arange(len(heights)), 2), parts)


def free(mesh: Mesh, origin: Float[ndarray, " 3"], direction: Float[ndarray, " 3"]) -> bool:
    """Whether a ray meets no triangle (Moeller and Trumbore 1997)."""
    a, b, c = np.moveaxis(mesh.positions[mesh.faces], 1, 0)
    across = np.cross(direction, c - a)
    volume = ((b - a) * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((origin - a) * across).sum(axis=1) / volume
        upward = np.cross(origin - a, b - a)
        v = (upward @ direction) / volume
        along = ((c - a) * upward).sum(axis=1) / volume
    return not ((u > 0) & (v > 0) & (u + v < 1) & (along > 0.02)).any()


def test_points_of_a_vehicle_are_seen_from_within_thirty_degrees_of_their_normals() -> None:
    mesh = build_vehicle(sample_vehicle("pickup", 3))
    body = np.array([part.name == "body" for part in mesh.parts])
    wanted = body[mesh.face_part]
    found = find_viewpoints(mesh, wanted, 48)
    assert found.points.shape == found.directions.shape == (48, 3)
    np.testing.assert_allclose(np.linalg.norm(found.directions, axis=1), 1.0)
    assert (found.directions[:, 1] >= 0.0).all(), "no photographer stands beneath the ground"
    corners = mesh.positions[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for point, direction in zip(found.points, found.directions, strict=True):
        off = np.abs(((corners[:, 0] - point) * normals).sum(axis=1)) < 1e-9
        steep = np.abs(normals @ direction) >= np.cos(np.radians(TILT_DEGREES))
        assert (off & steep & wanted).any(), "it lies on a wanted face that looks at the camera"
    assert np.mean([free(mesh, *pair) for pair in zip(found.points, found.directions, strict=True)]) > 0.95
    again = find_viewpoints(mesh, wanted, 48)
    assert np.array_equal(again.points, found.points)
    assert np.array_equal(again.directions, found.directions)


@pytest.mark.parametrize("flipped", [False, True])
def test_places_are_chosen_by_area_however_faces_are_wound(flipped: bool) -> None:
    found = find_viewpoints(squares(0.0, flipped=flipped), np.array([True, True]), 400)
    assert len(found.points) == 400
    assert (found.directions[:, 1] >= np.cos(np.radians(TILT_DEGREES))).all()
    counts, _, _ = np.histogram2d(found.points[:, 0], found.points[:, 2], bins=2, range=[[0, 1], [0, 1]])
    assert (np.abs(counts - 100) < 45).all()


def test_what_is_covered_is_not_chosen_but_glass_covers_nothing() -> None:
    wanted = np.array([True, True, False, False])
    covered = squares(0.0, 0.001)
    assert len(find_viewpoints(covered, wanted, 50).points) == 0
    assert len(find_viewpoints(squares(0.0, 0.001, alpha=0.2), wanted, 50).points) == 50
    apart = replace(covered, positions=covered.positions + np.repeat([[0.0, 0, 0], [9.0, 0, 0]], 4, axis=0))
    found = find_viewpoints(apart, wanted, 50)
    assert len(found.points) == 50
    assert (found.points[:, 0] <= 1.0).all(), "only wanted faces are chosen"


def test_faces_without_area_do_no_harm() -> None:
    mesh = squares(0.0)
    with_sliver = replace(mesh, faces=np.array([*mesh.faces, [0, 0, 1]]), face_part=np.array([0, 0, 0]))
    assert len(find_viewpoints(with_sliver, np.array([True, True, True]), 10).points) == 10
