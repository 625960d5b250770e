"""Everything that users bring loads: real vehicles, meshes and environments."""

from pathlib import Path

import numpy as np
import pytest

from svbrdfgan.io.environment import load_environment
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.mesh import load_mesh

pytestmark = pytest.mark.assets


def test_every_vehicle_loads_and_stands_on_the_ground(assets: Path) -> None:
    paths = sorted((assets / "cars").glob("*.glb"))
    assert paths
    for path in paths:
        mesh = load_mesh(path)
        lower, upper = mesh.bounds
        assert upper[2] - lower[2] == pytest.approx(1.0, abs=1e-3), path.name  # length 1 along Z
        assert lower[1] == pytest.approx(0.0, abs=1e-3), path.name
        assert len(np.unique(mesh.positions, axis=0)) == len(mesh.positions), path.name
        assert set(mesh.face_part) == set(range(len(mesh.parts))), path.name


def test_a_vehicle_comes_back_as_it_was(assets: Path, tmp_path: Path) -> None:
    mesh = load_mesh(sorted((assets / "cars").glob("*.glb"))[0])
    save_mesh_glb(tmp_path / "a.glb", mesh)
    again = load_mesh(tmp_path / "a.glb")
    np.testing.assert_array_equal(again.positions[again.faces], mesh.positions[mesh.faces])
    np.testing.assert_array_equal(again.face_part, mesh.face_part)
    assert again.parts == mesh.parts


def test_every_mesh_loads(assets: Path) -> None:
    paths = sorted((assets / "meshes").glob("*.obj"))
    assert paths
    for path in paths:
        mesh = load_mesh(path)
        assert [part.name for part in mesh.parts] == [path.stem]
        assert (mesh.uv is not None) == path.stem.endswith("_uv"), path.name


def test_every_environment_loads(assets: Path) -> None:
    paths = sorted((assets / "envmaps").glob("*.hdr"))
    assert paths
    for path in paths:
        radiance = load_environment(path)
        rows, cols, _ = radiance.shape
        assert cols == 2 * rows, path.name
        assert float(radiance.mean()) > 0.0, path.name
