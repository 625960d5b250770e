"""`benchmarks/captures.py`: which pictures it keeps, and that its scores order what is better and worse."""

from __future__ import annotations

import importlib.util
import json
import math
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import torch
import yaml
from camera_files import take, write_nerf
from click.testing import CliRunner, Result
from stand_ins import SMALL

from svbrdfgan.cli import main
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import load_image, save_image
from svbrdfgan.plugins.registry import load_embedding, load_renderer
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import make_subject
from svbrdfgan.types import Camera, Environment, Layer, View

FILE = Path(__file__).parents[3] / "benchmarks" / "captures.py"
SIDE, PICTURES = 96, 12
FOCAL = 140.0
TRAIN: dict[str, Any] = {
    "dataset": "exemplars",
    "steps": 2,
    "batch_size": 2,
    "device": "cpu",
    "generator": {"width": 4, "blocks": 1, "random_fields": 2, "conditions": False},
    "discriminator": {"width": 4, "layers": 1},
}


@pytest.fixture(scope="module")
def benchmark() -> ModuleType:
    spec = importlib.util.spec_from_file_location("captures", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(command: Any, *words: object) -> Result:
    result = CliRunner().invoke(command, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    return result


def photograph(folder: Path) -> None:
    """A van on a turntable, painted white on its left half and black on its right."""
    mesh = build_vehicle(sample_vehicle("van", 5))
    save_mesh_glb(folder / "van.glb", mesh)
    subject = make_subject(mesh, load_embedding("hemispherical", {}), 64, PartSelection())
    left = (subject.buffer.position[..., :1] > 0).float()
    materials = subject.materials(Layer(torch.cat([0.05 + 0.65 * left.expand(-1, -1, 3), torch.ones_like(left)], -1)))
    renderer = load_renderer("mitsuba", {"device": "cpu"})
    prepared, light = renderer.prepare(subject.surface), torch.full((16, 32, 3), 0.4)
    light[2:7, 2:10] = 2.0
    taken = [
        take(f"{n:02d}.exr", 360 * n / PICTURES, 0.0, (SIDE, SIDE), (FOCAL, FOCAL, SIDE / 2, SIDE / 2, 0, 0, 0, 0))
        for n in range(PICTURES)
    ]
    for number, one in enumerate(taken):
        x, y, z = (-one.rotation.T @ one.shift).tolist()
        camera = Camera((x, y, z), (0.0, 0.2, 0.0), vertical_fov=2 * math.atan(SIDE / 2 / FOCAL))
        turned = Environment(light, 2 * math.pi * number / PICTURES)
        picture = renderer.render(prepared, materials, View(camera, turned, SIDE, SIDE), spp=64, seed=number)
        save_image(folder / one.name, torch.cat([picture.image, picture.coverage.unsqueeze(-1)], dim=-1))
    write_nerf(folder / "transforms.json", taken)


@pytest.mark.parametrize("name", ["head", "tankard"])
def test_its_manifests_are_valid(name: str) -> None:
    manifest = read_manifest(load_yaml(FILE.with_name(f"{name}.yaml")), name)
    (capture,) = manifest.captures
    assert capture.turntable
    assert list(manifest.paint) == [capture.mesh]


@pytest.mark.full
def test_a_projected_texture_beats_a_constant(benchmark: ModuleType, tmp_path: Path) -> None:
    photograph(tmp_path)
    run(benchmark.main, "split", tmp_path / "transforms.json", "-o", tmp_path)
    kept, train = (json.loads((tmp_path / f"{name}.json").read_text())["frames"] for name in ("kept", "train"))
    assert [frame["file_path"] for frame in kept] == ["./03.exr", "./09.exr"]
    assert len(train) == PICTURES - len(kept)
    capture = {"cameras": "train.json", "images": ".", "mesh": "van.glb", "light_group": "a", "turntable": True}
    manifest = {**SMALL, "embedding": "hemispherical", "texture": 64, "image": [64, 64], "captures": [capture]}
    (tmp_path / "van.yaml").write_text(yaml.safe_dump(manifest))
    (tmp_path / "train.yaml").write_text(yaml.safe_dump(TRAIN))
    exemplars, learned = tmp_path / "exemplars", tmp_path / "run"
    run(main, "dataset", "import", tmp_path / "van.yaml", "-o", exemplars, "--workers", 1)
    run(main, "train", tmp_path / "train.yaml", "-o", learned)
    words = (tmp_path / "van.yaml", exemplars, learned, "--kept", tmp_path / "kept.json", "-o", tmp_path / "scores")
    said = run(benchmark.main, "score", *words).output
    found = json.loads((tmp_path / "scores" / "scores.json").read_text())
    assert "FLIP of 2 views" in said
    assert 0 < found["mean"]["projected"] < 0.85 * found["mean"]["constant"]
    assert found["way"] < 0.8, "two steps learn little"
    height, width, _ = load_image(tmp_path / "scores" / "kept.png").shape
    assert (height, width) == (2 * 64, 4 * 64)
