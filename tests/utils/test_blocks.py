"""Blocks and threads do not show in the result."""

import numpy as np
import pytest

from svbrdfgan.utils.threads import BLOCK, by_blocks
from svbrdfgan.weathering.noise import fbm


@pytest.mark.parametrize("count", [0, 1, BLOCK, BLOCK + 1, 3 * BLOCK + 5])
def test_each_row_has_its_own_value(count: int) -> None:
    first, second = np.random.default_rng(0).random((count, 3)), np.arange(count)
    found = by_blocks(lambda a, b: a.sum(axis=1) + b, first, second)
    np.testing.assert_array_equal(found, first.sum(axis=1) + second)


def test_errors_of_a_block_arrive() -> None:
    def fail(block: np.ndarray) -> np.ndarray:
        raise ValueError(f"{len(block)} points")

    with pytest.raises(ValueError, match="points"):
        by_blocks(fail, np.zeros(2 * BLOCK))


def test_noise_does_not_depend_on_the_points_beside() -> None:
    points = np.random.default_rng(1).uniform(-9, 9, (2 * BLOCK + 77, 3))
    whole = fbm(points, 5)
    np.testing.assert_array_equal(whole[::1000], fbm(points[::1000], 5))
    np.testing.assert_array_equal(whole[BLOCK - 3 : BLOCK + 3], fbm(points[BLOCK - 3 : BLOCK + 3], 5))
