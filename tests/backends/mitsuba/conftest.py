"""The renderer under test, on the CPU; its kernels are compiled once and kept on disk by Dr.Jit."""

import importlib.util

import pytest

if importlib.util.find_spec("mitsuba") is None:  # not imported here: the backend must choose LLVM first
    pytest.skip("the mitsuba renderer needs mitsuba", allow_module_level=True)

from svbrdfgan_mitsuba import MitsubaRenderer


@pytest.fixture(scope="session")
def renderer() -> MitsubaRenderer:
    return MitsubaRenderer(device="cpu")
