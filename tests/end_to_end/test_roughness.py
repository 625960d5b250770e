"""A second map from configuration to GLB: nothing in the core's training code knows which one it is."""

from __future__ import annotations

import json
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from click.testing import CliRunner
from safetensors.torch import load_file
from svbrdfgan_numpy import NumpyRenderer

from svbrdfgan.cli import main
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.exemplar_files import load_picture
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.inference.apply import paint
from svbrdfgan.io.image import load_image, srgb_from_linear
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.registry import load_renderer
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.scene.embedded_files import write_embedded
from svbrdfgan.training.batches import make_batch_source
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.training.online_rendering import OnlineSceneBatch
from svbrdfgan.training.resolve import resolve_run
from svbrdfgan.training.run import load_model
from svbrdfgan.training.state import State
from svbrdfgan.training.trainer import train
from svbrdfgan.types import Layer

Data = Callable[..., dict[str, Any]]
Settings = Callable[..., TrainConfig]
CPU = torch.device("cpu")
ONLINE: dict[str, Any] = {
    "rendering": "online",
    "discriminator": {"gbuffer": False},
    "spp": 2,
    "batch_size": 1,
    "score_every": 10,
    "save_every": 10,
}


@pytest.fixture(scope="module")
def declared(dataset_data: Data) -> Data:
    views = {"train": {"views": 2}, "validation": {"views": 1}}
    always = {"maps": {"roughness": {"uniform": [0.2, 0.5]}}, "weathering": {"recipe": "smooth-dirt"}}
    return lambda **changes: dataset_data(**always, spp=4, splits=views, **changes)


@pytest.fixture(scope="module")
def folder(declared: Data, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two vehicles to train on and one to validate with, whose paint and dirt have a roughness."""
    made = tmp_path_factory.mktemp("glossy") / "dataset"
    generate(dataset_config(declared(), "here"), made, base=Path())
    return made


@pytest.fixture(scope="module")
def settings(training_data: Data, folder: Path) -> Settings:
    return lambda **changes: train_config(training_data(**{"dataset": str(folder), **ONLINE, **changes}), "here")


@pytest.fixture(scope="module")
def run(settings: Settings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("glossy") / "run"
    train(settings(steps=10), made)
    return made


def test_exemplars_say_how_rough_paint_and_dirt_are(folder: Path) -> None:
    exemplars = load_exemplars(Dataset.open(folder), "train")
    bare = [scene.maps["roughness"] for scene in exemplars.scenes]
    assert len(set(bare)) == len(bare) == 4
    assert all(0.2 <= value <= 0.5 for value in bare)
    for layer in exemplars.layers:
        assert layer is not None
        assert layer.maps == ("roughness",)
        assert 0.85 <= layer["roughness"].min() < layer["roughness"].max() <= 0.95


def test_the_gradient_of_the_channel_is_alpha_times_that_of_the_map(settings: Settings, folder: Path) -> None:
    """Through compositing and materials. The kit compares the renderer's own with finite differences."""
    source = make_batch_source(resolve_run(settings()), "train", load_renderer("numpy"), CPU)
    scenes = source.scenes([0], np.random.default_rng(0))
    assert isinstance(scenes, OnlineSceneBatch)
    rng = torch.Generator().manual_seed(1)
    layers, cotangent = 0.3 + 0.4 * torch.rand(1, 32, 32, 5, generator=rng), torch.rand(1, 32, 32, 3, generator=rng)
    learned = layers.clone().requires_grad_(True)
    (scenes.render(learned)[0] * cotangent).sum().backward()
    assert learned.grad is not None
    subject, scene = scenes.exemplars.subject(0), scenes.scenes[0]
    gradients = scenes.layer.renderer.render_vjp(
        scenes.prepared[0],
        subject.materials(Layer(layers[0], ("roughness",)), scene.maps, base_colors=scene.materials),
        scenes.exemplars.loader.view(scene),
        cotangent[0],
        wrt=frozenset({"roughness"}),
        spp=scenes.layer.spp,
        seed=scene.seed,
    )
    (body,) = subject.learnable
    expected = layers[0, ..., 3] * gradients.materials[body]["roughness"][..., 0]
    assert expected.abs().sum() > 0.1
    torch.testing.assert_close(learned.grad[0, ..., 4], expected, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("renderer", [pytest.param("numpy", marks=pytest.mark.full), "mitsuba"])
def test_ten_steps_teach_the_channel(renderer: str, settings: Settings, run: Path, tmp_path: Path) -> None:
    """Only the gradient of its own map moves the last weights of a channel."""
    if renderer == "mitsuba":
        if find_spec("mitsuba") is None:
            pytest.skip("the mitsuba renderer needs mitsuba")
        run = tmp_path / "run"
        train(settings(steps=10, renderer={"name": "mitsuba", "device": "cpu"}), run)
    before = State.fresh(settings(steps=10), CPU, maps=("roughness",)).generator.state_dict()
    after = load_file(run / "checkpoints" / "step_00000010" / "state.safetensors")
    last = list(before)[-2]
    assert last.endswith("weight")
    moved = (after[f"generator.{last}"] - before[last]).abs()
    assert moved.shape[0] == 5
    assert (moved.flatten(1).max(dim=1).values > 1e-4).all()


def test_the_model_paints_and_exports_the_map(run: Path, folder: Path, tmp_path: Path) -> None:
    model = load_model(run)
    assert model.generator.maps == ("roughness",)
    assert model.config.maps == {"roughness": 0.35}
    subject, layer = paint(load_mesh(next((folder / "assets" / "meshes").iterdir())), model)
    assert layer.values.shape == (32, 32, 5)
    write_embedded(tmp_path / "car.glb", subject, layer, model.config.maps)
    assert {path.name for path in tmp_path.iterdir()} == {"car.glb", "car.layer.png", "car.roughness.png"}
    stored = srgb_from_linear(load_image(tmp_path / "car.roughness.png").flip(0))[..., 0]
    alpha, value = layer.alpha, layer["roughness"][..., 0]
    expected = 0.35 * (1 - alpha) + value * alpha
    torch.testing.assert_close(stored, expected, atol=0.6 / 255, rtol=0)
    scene = trimesh.load_scene(tmp_path / "car.glb")
    painted = [geometry.visual.material for geometry in scene.geometry.values()]
    painted = [material for material in painted if material.metallicRoughnessTexture is not None]
    pictures = [np.asarray(material.metallicRoughnessTexture) for material in painted]
    (shown,) = {picture.tobytes(): picture for picture in pictures}.values()
    np.testing.assert_allclose(shown[::-1, :, 1] / 255, expected.numpy(), atol=0.6 / 255)
    assert {material.metallicFactor for material in painted} == {0.0}


@pytest.mark.full
def test_the_verdict_names_the_map(run: Path) -> None:
    evaluated = evaluate(run, split="validation", device="cpu", schedule=OracleConfig(every=2, steps=4))
    found = evaluated.evaluation
    scores, worst = found.generated.maps, found.constant.errors["roughness"]
    assert scores.keys() == {"base_color", "roughness"}
    assert scores["roughness"].error is not None
    assert worst is not None
    assert scores["roughness"].recovered == pytest.approx(1 - scores["roughness"].error / worst)
    assert 0.2 < found.areas["roughness"] <= found.seen == found.areas["base_color"]
    assert scores["base_color"].recovered == found.generated.recovered
    assert found.lines()[-1].startswith("roughness  ")
    assert all(layer.shape[1:] == (32, 32, 5) for layer in evaluated.layers.values())
    assert found.truth.flip < found.constant.flip


def test_the_model_is_chosen_by_the_mean_of_its_maps(run: Path) -> None:
    log = [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]
    (scored,) = [line for line in log if "recovered" in line]
    maps = [max(scored[f"recovered_{name}"], -1.0) for name in ("base_color", "roughness")]
    assert scored["recovered"] == pytest.approx(sum(maps) / 2)
    assert load_model(run).score == pytest.approx(scored["recovered"])


def test_a_stored_scene_renders_again(folder: Path, tmp_path: Path) -> None:
    words = ["render", str(folder / "train" / "000001.json"), "-o", str(tmp_path / "again.exr")]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    stored = load_picture(folder / "train" / "000001.exr").float()
    torch.testing.assert_close(load_image(tmp_path / "again.exr"), stored, rtol=2e-3, atol=2e-3)


def test_a_renderer_that_stores_no_light_is_refused(settings: Settings, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"numpy does not: set rendering: online or choose") as caught:
        train(settings(rendering="stored", renderer="numpy"), tmp_path / "run")
    assert len(str(caught.value).splitlines()) == 1


def test_a_renderer_without_the_map_is_refused(
    declared: Data, settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before anything is written that would have to be deleted."""
    monkeypatch.setattr(NumpyRenderer, "capabilities", RendererCapabilities())
    with pytest.raises(ConfigError, match=r"^numpy renderer cannot learn roughness, .*choose a renderer that can"):
        train(settings(renderer="numpy"), tmp_path / "run")
    with pytest.raises(ConfigError, match=r"^numpy renderer cannot render roughness, .*choose a renderer that can"):
        generate(dataset_config(declared(renderer="numpy"), "here"), tmp_path / "data", base=Path())
    assert not (tmp_path / "data").exists()
