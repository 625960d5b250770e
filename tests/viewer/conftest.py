"""A van that is weathered in the viewer."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from svbrdfgan.viewer.exhibit import Exhibit
from svbrdfgan.viewer.open import exhibit_of

pytest.importorskip("xatlas")


@pytest.fixture(scope="session")
def van(van: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The van, with a name that pages and shells must take care of."""
    return shutil.copy(van, tmp_path_factory.mktemp("viewer") / "white <van>.glb")


@pytest.fixture(scope="session")
def exhibit(van: Path) -> Exhibit:
    """The van under dust or what the shipped models learned."""
    return exhibit_of(van)


@pytest.fixture(scope="session")
def dusty(van: Path) -> Exhibit:
    """The van under dust alone, as a page without a server would have it."""
    return exhibit_of(van, recipe="dust", fine=512, baked=((0, 1), (0.5, 1.0)))
