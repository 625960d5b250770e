"""What every program is given."""

import io
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch

from svbrdfgan.bench.bench_scene import BenchScene
from svbrdfgan.bench.standard_scenes import standard_scene, vehicle_scene
from svbrdfgan.errors import AssetError
from svbrdfgan.io.environment import save_environment
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle


def test_the_file_keeps_all_of_it(tiny: BenchScene, tmp_path: Path) -> None:
    tiny.save(tmp_path / "scene.npz")
    read = BenchScene.load(tmp_path / "scene.npz")
    for field in fields(BenchScene):
        np.testing.assert_array_equal(getattr(read, field.name), getattr(tiny, field.name), err_msg=field.name)
    assert read.view().camera == tiny.view().camera


def test_a_file_of_something_else_is_reported(tmp_path: Path) -> None:
    np.savez(tmp_path / "other.npz", a=np.zeros(1))
    (tmp_path / "damaged.npz").write_bytes(b"PK damaged")
    for name in ("other", "damaged", "missing"):
        with pytest.raises(AssetError, match=f"{name}.npz cannot be read as a scene"):
            BenchScene.load(tmp_path / f"{name}.npz")


@pytest.mark.parametrize(
    "change",
    [
        {"positions": np.zeros((3, 2), np.float32)},
        {"uv": np.array("words")},
        {"width": np.array([1, 2])},
        {"faces": np.full((1, 3), 10**6, np.int32)},
        {"repeat": np.zeros(1, bool)},
        {"rotation": np.array(np.nan)},
        {"texture": np.array(None)},
    ],
    ids=lambda change: next(iter(change)),
)
def test_a_damaged_file_is_reported(tiny: BenchScene, tmp_path: Path, change: dict[str, np.ndarray]) -> None:
    np.savez(tmp_path / "scene.npz", **{**{f.name: getattr(tiny, f.name) for f in fields(BenchScene)}, **change})
    with pytest.raises(AssetError, match=r"scene.npz cannot be read as a scene"):
        BenchScene.load(tmp_path / "scene.npz")


@pytest.mark.parametrize("version", [(1, 0), (2, 0)])
def test_an_array_that_claims_more_than_the_file_holds_is_not_made(
    tiny: BenchScene, tmp_path: Path, version: tuple[int, int]
) -> None:
    tiny.save(tmp_path / "whole.npz")
    header = io.BytesIO()
    claimed = {"descr": "<f4", "fortran_order": False, "shape": (2**30, 9)}
    write = np.lib.format.write_array_header_1_0 if version == (1, 0) else np.lib.format.write_array_header_2_0
    write(header, claimed)
    with zipfile.ZipFile(tmp_path / "whole.npz") as whole, zipfile.ZipFile(tmp_path / "scene.npz", "w") as damaged:
        for name in whole.namelist():
            damaged.writestr(name, header.getvalue() if name == "positions.npy" else whole.read(name))
    with pytest.raises(
        AssetError, match=r"positions claims the shape \(1073741824, 9\), which the file's bytes cannot"
    ):
        BenchScene.load(tmp_path / "scene.npz")


def test_the_standard_scene_is_the_one_that_was_measured_before() -> None:
    """A rippled ellipsoid of a square number of vertices, lit by a small sun; outward unit normals."""
    scene = standard_scene(2500, 256, 64)
    assert (scene.positions.shape, scene.faces.shape) == ((2500, 3), (2 * 49 * 49, 3))
    assert (scene.width, scene.height) == (256, 256)
    np.testing.assert_allclose(np.linalg.norm(scene.normals, axis=1), 1.0, atol=1e-6)
    assert np.mean(np.einsum("vx,vx->v", scene.normals, scene.positions) > 0) > 0.95
    np.testing.assert_allclose(np.ptp(scene.positions, axis=0), (3.2, 1.2, 1.6), rtol=0.15)
    assert 0.39 < scene.texture.mean() < 0.41
    assert (scene.radiance > 20).all(axis=-1).mean() == pytest.approx(20 * 30 / (256 * 512))
    np.testing.assert_array_equal(scene.faces, standard_scene(2500).faces)


def test_a_vehicle(tmp_path: Path) -> None:
    """Its learnable parts are one, with the texture; it fills the picture; other parts are plain."""
    mesh = build_vehicle(sample_vehicle("van", 5))
    save_mesh_glb(tmp_path / "van.glb", mesh)
    save_environment(tmp_path / "sky.exr", torch.ones(8, 16, 3))
    embedding = load_embedding("hemispherical")
    scene = vehicle_scene(tmp_path / "van.glb", tmp_path / "sky.exr", embedding, 16, 32)
    parts = len(scene.base_color)
    assert 1 < parts <= 2 * len(mesh.parts)
    assert set(np.unique(scene.face_part)) == set(range(parts))
    assert scene.embedding_s > 0
    renderer, surface = load_renderer("numpy"), scene.surface()
    black, white = (
        renderer.render(renderer.prepare(surface), scene.materials({"base_color": color}), scene.view(), spp=2, seed=0)
        for color in (torch.zeros(32, 32, 3), torch.ones(32, 32, 3))
    )
    assert 0.15 < float(white.coverage.mean()) < 0.6
    learnable = (white.image - black.image).sum(-1) > 0.1
    assert 0.3 < float(learnable.sum() / (white.coverage > 0).sum()) <= 1.0
    assert float(black.image.max()) > 0.01  # glass and tyres stay
