"""Triton is probed before its kernels are used."""

from __future__ import annotations

import importlib.util

import pytest
import torch

from svbrdfgan.utils.triton_works import triton_works

CUDA = torch.cuda.is_available()


def test_a_warning_says_where_triton_does_not_work(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delenv("TRITON_INTERPRET", raising=False)
    works = triton_works.__wrapped__(torch.device("cuda"))
    assert works == (CUDA and importlib.util.find_spec("triton") is not None)
    assert ("torch's own operations replace it, slower" in caplog.text) == (not works)
