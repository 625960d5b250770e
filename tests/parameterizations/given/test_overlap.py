"""Overlap of triangles and packing of boxes, against truths."""

import tracemalloc

import numpy as np
import pytest
from svbrdfgan_given.embedding import pack
from svbrdfgan_given.overlap import overlapping_pairs

RIGHT = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
CASES = {
    "the same": (RIGHT, True),
    "within": (RIGHT * 0.2 + 0.2, True),
    "around": (RIGHT * 5 - 1, True),
    "across, no corner in the other": (np.array([[-0.5, 0.2], [2.0, 0.2], [2.0, 0.3]]), True),
    "over the long side": (np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), False),
    "at a corner": (RIGHT + np.array([1, 0]), False),
    "side to longer side": (np.array([[-1.0, -2.0], [0.0, -1.0], [0.0, 3.0]]), False),
    "boxes meet, triangles do not": (1.0 - 0.9 * RIGHT + 0.05, False),
    "reaching in by rounding": (np.array([[1.0, -1e-8], [1.0, 1.0], [-1e-8, 1.0]]) - 1e-8, False),
    "reaching in by more": (np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) - 1e-4, True),
}


@pytest.mark.parametrize("name", CASES)
def test_two_triangles(name: str) -> None:
    other, overlaps = CASES[name]
    for pair in (np.stack([RIGHT, other]), np.stack([other, RIGHT])):
        found = list(overlapping_pairs(pair, np.zeros(2, dtype=np.int64)))
        assert any(len(pairs) for pairs in found) == overlaps
        assert not any(len(pairs) for pairs in overlapping_pairs(pair, np.arange(2)))


def test_many_triangles_as_clipping_finds_them() -> None:
    random = np.random.default_rng(2)
    corners = random.uniform(size=(60, 1, 2)) + 0.12 * random.normal(size=(60, 3, 2))
    p, q = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    turned = p[:, 0] * q[:, 1] < p[:, 1] * q[:, 0]
    corners[turned] = corners[turned][:, [0, 2, 1]]
    pieces = overlapping_pairs(corners, np.zeros(60, dtype=np.int64))
    found = sorted(tuple(sorted(pair)) for pairs in pieces for pair in pairs.tolist())
    shared = {(i, j) for i in range(60) for j in range(i + 1, 60) if shared_area(corners[i], corners[j]) > 1e-9}
    assert len(shared) > 50
    assert found == sorted(shared)


def test_a_few_large_triangles_among_small_ones_take_little_memory() -> None:
    small = np.random.default_rng(2).uniform(size=(20_000, 1, 2)) + RIGHT / 256
    corners = np.concatenate([small, np.tile(RIGHT, (40, 1, 1))])
    tracemalloc.start()
    try:
        assert not any(len(pairs) for pairs in overlapping_pairs(corners, np.arange(len(corners))))
        assert tracemalloc.get_traced_memory()[1] < 40e6
    finally:
        tracemalloc.stop()


def shared_area(one: np.ndarray, other: np.ndarray) -> float:
    """Of two counter-clockwise triangles, by clipping one at the sides of the other (Sutherland and Hodgman 1974)."""
    polygon = list(one)
    for k in range(3):
        start, along = other[k - 1], other[k] - other[k - 1]
        side = [along[0] * (p - start)[1] - along[1] * (p - start)[0] for p in polygon]
        clipped = []
        for i in range(len(polygon)):
            if side[i - 1] * side[i] < 0:
                clipped.append(polygon[i - 1] + side[i - 1] / (side[i - 1] - side[i]) * (polygon[i] - polygon[i - 1]))
            if side[i] >= 0:
                clipped.append(polygon[i])
        polygon = clipped
    x, y = np.array(polygon).reshape(-1, 2).T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def test_one_box_fills_the_square_but_for_the_gutter() -> None:
    scale, corners = pack(np.array([[2.0, 1.0]]), np.zeros((1, 2)), 0.1) or (0.0, np.zeros((1, 2)))
    assert scale == pytest.approx(0.45)
    np.testing.assert_allclose(corners, [[0.05, 0.05]])


def test_many_boxes_fill_most_of_it() -> None:
    sizes = np.random.default_rng(0).uniform(0.2, 1.0, size=(200, 2))
    scale, corners = pack(sizes, np.zeros_like(sizes), 0.0) or (0.0, sizes)
    assert (corners + scale * sizes).max() <= 1.0
    assert (scale * sizes).prod(axis=1).sum() > 0.8


def test_what_cannot_fit_is_told() -> None:
    assert pack(np.ones((3, 2)), np.ones((3, 2)), 0.0) is None
