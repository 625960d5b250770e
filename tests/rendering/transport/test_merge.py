"""Sums over equal keys."""

import pytest
import torch

from svbrdfgan.rendering.transport.merge import Entries, Runs, segment_sums


@pytest.mark.parametrize("device", ("cpu", "cuda") if torch.cuda.is_available() else ("cpu",))
def test_merging_sums_each_key(device: str) -> None:
    rng = torch.Generator().manual_seed(0)
    key, value = torch.randint(2**34, (300,), generator=rng), torch.rand(4000, 4, generator=rng)
    key = key[torch.randint(300, (4000,), generator=rng)]
    merged = Entries(key.to(device), value.to(device)).merged()
    expected = {int(k): value[key == k].double().sum(0) for k in key.unique()}
    assert merged.key.tolist() == sorted(expected)
    torch.testing.assert_close(merged.value.cpu(), torch.stack([expected[int(k)] for k in merged.key]).float())


def test_runs_keep_the_order_of_their_rows() -> None:
    runs = Runs.of(torch.tensor([5, 1, 5, 9, 1, 5]))
    assert runs.key.tolist() == [1, 5, 9]
    assert runs.length.tolist() == [2, 3, 1]
    assert runs.order.tolist() == [1, 4, 0, 2, 5, 3]
    assert runs.first().tolist() == [1, 0, 3]


def test_empty_segments_sum_to_zero() -> None:
    assert segment_sums(torch.ones(3, 2), torch.tensor([0, 2, 0, 1, 0]))[:, 0].tolist() == [0, 2, 0, 1, 0]
    assert segment_sums(torch.ones(0, 2), torch.tensor([0, 0])).tolist() == [[0, 0], [0, 0]]
