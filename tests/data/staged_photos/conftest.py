"""Lets these tests have the Blender of the tests of assets."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[2] / "asset"))


@pytest.fixture(scope="session")
def blender_python() -> Path:
    """A Python with bpy, installed at first use."""
    from blender import python

    return python()
