"""Embeddings over a folder of meshes: pairs, medians and worst, what fails, and xatlas beside them."""

import json
import math
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import trimesh

from svbrdfgan.errors import AssetError, EmbeddingError, PluginError
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.geometry.split import surface_from_corners
from svbrdfgan.geometry.subdivide import Pieces
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.metrics.uv import xatlas_baseline
from svbrdfgan.metrics.uv.compare import as_json, measure_embedding, mesh_files, sample_pairs
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.types import Mesh, Surface


@dataclass(frozen=True)
class FromTheFront:
    """Upright rectangles over the whole square; what is not upright is refused."""

    capabilities = UVCapabilities(injective=True, subdivides=False)

    def embed(self, mesh: Mesh) -> Surface:
        low, high = mesh.bounds
        if high[1] - low[1] < 1e-9:
            raise EmbeddingError("the mesh lies flat; stand it up.")
        return surface_from_corners(
            Pieces.whole(mesh.positions, mesh.faces),
            normals=corner_normals(mesh.positions, mesh.faces),
            uv=((mesh.positions - low)[:, :2] / (high - low)[:2])[mesh.faces],
            elevation=np.zeros(mesh.faces.shape),
            face_part=mesh.face_part,
            parts=mesh.parts,
        )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Rectangles of 1 x 1, 2 x 1 and 4 x 1 metres, one that lies flat, and a file that is no mesh."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
    for name, size in {"one": (1, 1, 1), "two": (2, 1, 1), "four": (4, 1, 1)}.items():
        trimesh.Trimesh(corners * size, [[0, 1, 2], [0, 2, 3]]).export(tmp_path / f"{name}.obj")
    trimesh.Trimesh(corners[:, [0, 2, 1]], [[0, 1, 2], [0, 2, 3]]).export(tmp_path / "flat.obj")
    (tmp_path / "notes.txt").write_text("no mesh")
    return tmp_path


def test_medians_the_worst_and_failures(folder: Path) -> None:
    told: list[str] = []
    found = measure_embedding(FromTheFront(), mesh_files(folder), 64, told.append)
    assert found.failures == {"flat.obj": "the mesh lies flat; stand it up."}
    assert told[:4] == ["flat.obj", "four.obj", "one.obj", "two.obj"]
    summary = found.summary()
    assert summary["stretch_linf"] == {
        "median": pytest.approx(math.sqrt(2)),
        "worst": pytest.approx(2.0),
        "of": "four.obj",
    }
    assert summary["coverage"]["worst"] == 1.0
    assert summary["similarity"]["worst"] == pytest.approx(0.0, abs=1e-6)
    assert len(found.similarities) == 3
    assert {"area", "seen"}.isdisjoint(summary)


@pytest.mark.full
def test_json_holds_all_of_it(folder: Path) -> None:
    found = measure_embedding(FromTheFront(), mesh_files(folder), 64, lambda _: None)
    data = json.loads(json.dumps(as_json({"front": found}), allow_nan=False))["front"]
    assert data["meshes"]["four.obj"]["stretch_linf"] == pytest.approx(2.0)
    assert data["meshes"]["four.obj"]["area"] == pytest.approx(4.0)
    assert data["failures"] == {"flat.obj": "the mesh lies flat; stand it up."}
    assert [sorted(row["meshes"]) for row in data["similarity"]] == [
        ["four.obj", "one.obj"],
        ["four.obj", "two.obj"],
        ["one.obj", "two.obj"],
    ]


def test_few_meshes_are_all_compared() -> None:
    assert sample_pairs(["a", "b", "c"]) == [("a", "b"), ("a", "c"), ("b", "c")]
    assert sample_pairs(["a"]) == []


def test_many_are_compared_evenly_and_alike_at_every_call() -> None:
    names = [f"{family}_{number:02}" for family in ("kenney", "real") for number in range(31)]
    pairs = sample_pairs(names)
    assert pairs == sample_pairs(names)
    assert len({frozenset(pair) for pair in pairs}) == len(pairs) == 124
    assert set(Counter(name for pair in pairs for name in pair).values()) == {4}
    within = np.mean([one[:4] == other[:4] for one, other in pairs])
    assert within == pytest.approx(30 / 61, abs=0.18)  # as by chance, within four standard errors


@pytest.mark.parametrize("name", ["empty", "missing"])
def test_a_folder_without_meshes_is_an_error(tmp_path: Path, name: str) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(AssetError, match="holds no mesh"):
        mesh_files(tmp_path / name)


def test_xatlas_is_asked_for_where_it_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xatlas_baseline.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(PluginError, match="pip install xatlas"):
        xatlas_baseline.XatlasBaseline()


@pytest.fixture
def stand_in(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A module that answers as xatlas does: vertices of its own, split at will."""
    module = ModuleType("xatlas")

    def parametrize(positions: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        assert (positions.dtype, faces.dtype) == (np.float32, np.uint32)
        own = np.arange(faces.size, dtype=np.uint32)[::-1]
        uv = (positions[faces.ravel()][:, :2] / positions[:, :2].max(axis=0))[::-1]
        return faces.ravel()[::-1], own.reshape(faces.shape), np.ascontiguousarray(uv, dtype=np.float32)

    module.parametrize = parametrize  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "xatlas", module)
    monkeypatch.setattr(xatlas_baseline.importlib.util, "find_spec", lambda name: module)
    return module


@pytest.mark.usefixtures("stand_in")
def test_xatlas_is_read_by_its_own_vertices(folder: Path) -> None:
    mesh = load_mesh(folder / "two.obj")
    surface = xatlas_baseline.XatlasBaseline().embed(mesh)
    np.testing.assert_allclose(surface.uv[surface.faces] * (2, 1), mesh.positions[mesh.faces][..., :2], atol=1e-6)


def test_xatlas_that_loses_faces_is_told(folder: Path, stand_in: ModuleType) -> None:
    stand_in.parametrize = lambda positions, faces: (faces[:1], faces[:1], positions)  # type: ignore[attr-defined]
    with pytest.raises(EmbeddingError, match="xatlas gave 1 faces for 2"):
        xatlas_baseline.XatlasBaseline().embed(load_mesh(folder / "two.obj"))
