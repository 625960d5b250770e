"""A van that is weathered in the viewer."""

from __future__ import annotations

from pathlib import Path

import pytest

from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.viewer.exhibit import Exhibit
from svbrdfgan.viewer.open import exhibit_of

pytest.importorskip("xatlas")


@pytest.fixture(scope="session")
def van(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("viewer") / "white <van>.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return path


@pytest.fixture(scope="session")
def exhibit(van: Path) -> Exhibit:
    """The van under dust or what the shipped models learned."""
    return exhibit_of(van)


@pytest.fixture(scope="session")
def dusty(van: Path) -> Exhibit:
    """The van under dust alone, as a page without a server would have it."""
    return exhibit_of(van, recipe="dust", fine=512, baked=((0, 1), (0.5, 1.0)))
