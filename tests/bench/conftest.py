"""Fixtures of the benchmarks' tests."""

import pytest

from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.standard_scenes import standard_scene


@pytest.fixture(scope="session")
def tiny() -> BenchScene:
    """The standard scene with 196 vertices, 8x8 pixels and 16x16 texels."""
    return standard_scene(200, 8, 16)
