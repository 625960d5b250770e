"""Fixtures that every test may use."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def assets() -> Path:
    """The folder of real vehicles, environments and meshes, or a skip that says how to get it."""
    folder = os.environ.get("SVBRDFGAN_ASSETS")
    if not folder:
        pytest.skip("SVBRDFGAN_ASSETS is not set: point it at a folder with cars/, envmaps/ and meshes/ to run this test")
    return Path(folder)
