"""The renderer under test, on the CPU; its kernels are compiled once."""

import pytest

pytest.importorskip("warp", reason="the warp renderer needs warp-lang")

from svbrdfgan_warp import WarpRenderer


@pytest.fixture(scope="session")
def renderer() -> WarpRenderer:
    return WarpRenderer(device="cpu")
