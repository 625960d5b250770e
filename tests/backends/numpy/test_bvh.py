"""The tree finds exactly what trying every triangle finds."""

import numpy as np
import pytest
from svbrdfgan_numpy.bvh import Hits, build, intersect, search


def _soup(faces: int) -> np.ndarray:
    rng = np.random.default_rng(faces)
    return rng.uniform(-1, 1, (faces, 1, 3)) + rng.normal(0, 0.2, (faces, 3, 3))


def _rays(count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(7)
    direction = rng.normal(size=(count, 3))
    return rng.uniform(-2, 2, (count, 3)), direction / np.linalg.norm(direction, axis=1, keepdims=True)


def _brute_force(corners: np.ndarray, origin: np.ndarray, direction: np.ndarray) -> Hits:
    """The first triangle that each ray meets, by trying them all."""
    hits = Hits.none(len(origin))
    rays = np.arange(len(origin))
    for face, triangle in enumerate(corners):
        tries = intersect(np.broadcast_to(triangle, (len(rays), 3, 3)), origin, direction)
        hits.keep_nearer(rays, np.full(len(rays), face), *tries)
    return hits


@pytest.mark.parametrize("faces", [1, 2, 3, 7, 8, 300])
def test_search_equals_brute_force(faces: int) -> None:
    corners, (origin, direction) = _soup(faces), _rays(600)
    hits, truth = search(build(corners), origin, direction), _brute_force(corners, origin, direction)
    assert np.array_equal(hits.face, truth.face)
    assert np.array_equal(hits.distance, truth.distance)
    assert np.array_equal(hits.barycentric, truth.barycentric)
    assert np.array_equal(search(build(corners), origin, direction, any_hit=True).found, truth.found)
    assert faces < 100 or 0.1 < truth.found.mean() < 0.9


def test_rays_along_the_axes_meet_flat_boxes() -> None:
    x, y = np.meshgrid(np.arange(8.0), np.arange(8.0))
    corner = np.stack([x.ravel(), y.ravel(), np.full(64, 3.0)], axis=-1)
    corners = corner[:, None] + np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    origin = corner + np.array([0.25, 0.25, -5.0])
    hits = search(build(corners), origin, np.tile([0.0, 0.0, 1.0], (64, 1)))
    assert np.array_equal(hits.face, np.arange(64))
    assert np.allclose(hits.distance, 5.0)
    assert not search(build(corners), origin, np.tile([1.0, 0.0, 0.0], (64, 1))).found.any()


def test_each_leaf_box_holds_its_faces() -> None:
    tree = build(_soup(101))
    for leaf in range(tree.leaves):
        inside = tree.corners[tree.order[leaf * 101 // tree.leaves : (leaf + 1) * 101 // tree.leaves]]
        lower, upper = tree.bounds[tree.leaves + leaf]
        assert (inside >= lower).all()
        assert (inside <= upper).all()
    assert np.array_equal(np.sort(tree.order), np.arange(101))


def test_a_face_without_area_is_never_met() -> None:
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]])
    assert not search(build(corners), np.array([[0.5, 0.0, 1.0]]), np.array([[0.0, 0.0, -1.0]])).found.any()
