"""Lets the tests of this folder say `import known_maps`."""

import sys
from pathlib import Path

import pytest

from svbrdfgan.types import Surface

sys.path.append(str(Path(__file__).parent))


@pytest.fixture(scope="session")
def hemisphere() -> Surface:
    """The thesis's map of half a sphere, fine enough for three digits."""
    from known_maps import dome, sheet

    return sheet(dome, 256, 256)
