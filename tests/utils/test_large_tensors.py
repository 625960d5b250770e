"""Tensors that are too large for memory lie in files."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.utils.large_tensors import half_tensor, most_in_memory
from svbrdfgan.utils.memory import limited


@pytest.mark.parametrize("limit", [1 << 20, 1 << 30])
def test_a_tensor_is_the_same_in_a_file_and_in_memory(limit: int, tmp_path: Path) -> None:
    with limited(limit):
        assert most_in_memory() == limit // 16
        made = half_tensor((64, 32, 32, 4), tmp_path / "cache")
    assert (tmp_path / "cache").exists() == (limit == 1 << 20)
    assert made.shape == (64, 32, 32, 4)
    assert made.dtype == torch.half
    assert not made.any()
    values = torch.rand(32, 32, 4).half()
    made[3] = values
    assert torch.equal(made[[3, 0]], torch.stack([values, torch.zeros_like(values)]))
    assert not list(tmp_path.rglob("*.*")), "the file has no name"


def test_a_folder_that_cannot_hold_it_is_told(tmp_path: Path) -> None:
    (tmp_path / "cache").write_text("a file")
    with limited(1 << 20), pytest.raises(AssetError, match=r"cache cannot hold 0\.0 GiB of pictures"):
        half_tensor((64, 32, 32, 4), tmp_path / "cache")
