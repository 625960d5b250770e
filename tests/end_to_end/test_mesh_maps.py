"""A generator that reads mesh maps: trained, scored, applied to a mesh, and used to paint a data set."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.inference.apply import choose_draw, paint
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.training.config import train_config
from svbrdfgan.training.run import load_model
from svbrdfgan.training.trainer import train

Data = Callable[..., dict[str, Any]]


@pytest.fixture(scope="module")
def run(varied_dataset: Path, training_data: Data, built_once: Any) -> Path:
    changes = {"dataset": str(varied_dataset), "generator": {"mesh_maps": True, "random_fields": 2, "skips": True}}
    return (
        built_once("mesh maps", lambda f: train(train_config(training_data(**changes), "here"), f / "run") and None)
        / "run"
    )


def test_it_paints_the_same_on_a_mesh_and_in_a_data_set(run: Path, dataset_data: Data, tmp_path: Path) -> None:
    data = dataset_data(weathering={"model": str(run)})
    del data["embedding"], data["texture"]
    generate(validate(DatasetConfig, data, "here"), tmp_path / "made", base=tmp_path)
    made, model = load_exemplars(Dataset.open(tmp_path / "made"), "train"), load_model(run)
    scene, layer = made.scenes[0], made.layers[0]
    weathering: Any = scene.weathering
    asked = {"seed": weathering.seed, "amount": weathering.amount, "recipe": weathering.recipe}
    _, painted = paint(load_mesh(made.loader.file(scene.mesh)), model, **asked)
    assert layer is not None
    torch.testing.assert_close(painted.values, layer.values, atol=2 / 255, rtol=0)


def test_it_reads_them(run: Path, varied_dataset: Path) -> None:
    model = load_model(run)
    subject = load_exemplars(Dataset.open(varied_dataset), "train", GeneratorConfig(mesh_maps=True)).subjects[0]
    draw, geometry = choose_draw(model, seed=0, recipe="rust"), subject.generator_input.unsqueeze(0)
    assert geometry.shape[1] == model.generator.inputs == 11
    torch.testing.assert_close(geometry[0, :6], subject.geometry, rtol=0, atol=0)
    changed = geometry.clone()
    changed[:, 6:] = -changed[:, 6:]
    assert not torch.allclose(draw(geometry), draw(changed))


def test_it_paints_finer_with_the_maps_of_its_own_resolution(run: Path, varied_dataset: Path) -> None:
    exemplars, model = load_exemplars(Dataset.open(varied_dataset), "train"), load_model(run)
    mesh, trained = load_mesh(exemplars.loader.file(exemplars.scenes[0].mesh)), model.config.dataset.texture
    subject, layer = paint(mesh, model, recipe="rust", resolution=2 * trained)
    assert layer.alpha.shape == subject.buffer.mask.shape == (2 * trained, 2 * trained)


@pytest.mark.full
def test_it_is_scored_beside_an_oracle_that_reads_them_too(run: Path) -> None:
    found = evaluate(run, split="validation", device="cpu").evaluation
    assert found.generated.draws is not None
    assert found.oracle.draws is not None
