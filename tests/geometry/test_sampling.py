"""Samples are even: their means are those of what they stand for."""

import numpy as np
import pytest

from svbrdfgan.geometry.normals import uv_areas
from svbrdfgan.geometry.sampling import faces_by_area, points_in_triangle, upper_frames


def test_faces_get_points_by_their_areas() -> None:
    face = faces_by_area(np.cumsum([1.0, 0.0, 3.0, 0.5]), 450)
    assert np.bincount(face).tolist() == [100, 0, 300, 50]
    assert (np.diff(face) >= 0).all()


def test_points_fill_a_triangle_evenly() -> None:
    weights = points_in_triangle(np.arange(1000))
    assert weights.min() >= 0.0
    np.testing.assert_allclose(weights.sum(axis=1), 1.0)
    np.testing.assert_allclose(weights.mean(axis=0), 1 / 3, atol=2e-3)
    np.testing.assert_allclose((weights > 0.5).mean(axis=0), 1 / 4, atol=5e-3)


@pytest.mark.parametrize("order", [np.arange(64), np.arange(64)[::-1]])
def test_directions_fill_the_upper_half_evenly(order: np.ndarray) -> None:
    frames = upper_frames(order)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.tile(np.eye(3), (64, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    axes = frames[:, 2]
    assert axes[:, 1].min() > 0.0
    assert (np.sign(np.diff(axes[:, 1])) == np.sign(np.diff(order))).all()
    np.testing.assert_allclose(axes.mean(axis=0), [0.0, 0.5, 0.0], atol=0.02)


def test_areas_of_the_plane_have_a_sign() -> None:
    triangle = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    assert uv_areas(np.stack([triangle, triangle[::-1], triangle * [1.0, 0.0]])).tolist() == [1.0, -1.0, 0.0]
