"""Equal rows are merged, and only they."""

import numpy as np

from svbrdfgan.io.rows import merge_rows


def test_equal_rows_alone_are_merged_and_keep_their_order() -> None:
    rows = np.array([[1.0, 0, 0], [0, 0, 0], [1, 0, 0], [-0.0, 0, 0], [1, 1e-12, 0]])
    merged, index = merge_rows(rows)
    np.testing.assert_array_equal(merged, [[1, 0, 0], [0, 0, 0], [1, 1e-12, 0]])
    np.testing.assert_array_equal(index, [0, 1, 0, 1, 2])


def test_it_agrees_with_numpy_on_many_rows() -> None:
    rows = np.random.default_rng(0).integers(0, 5, (500, 3)).astype(float)
    merged, index = merge_rows(rows)
    assert len(merged) == len(np.unique(rows, axis=0))
    np.testing.assert_array_equal(merged[index], rows)
