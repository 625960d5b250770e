"""A trained generator on a mesh of one's own: which draw it paints, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from svbrdfgan.data.config import CameraDistribution, CloseUps
from svbrdfgan.errors import ConfigError
from svbrdfgan.inference.apply import Canvas, explain_memory, paint
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.learned_painter import LearnedPainter
from svbrdfgan.inference.workpiece import open_workpiece
from svbrdfgan.metrics.texture_pyramid import octaves, premultiplied
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.saved import GeneratorConfig, make_generator
from svbrdfgan.networks.tiles import Windows
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training.run import Model, load_model
from svbrdfgan.types import Layer, Mesh


@pytest.fixture(scope="module")
def model(varied_run: Path) -> Model:
    return load_model(varied_run)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return build_vehicle(sample_vehicle("van", 5))


@pytest.fixture
def windowed(model: Model, monkeypatch: pytest.MonkeyPatch) -> Model:
    """A model of windows of 32 texels of maps of 64, which reads 32 texels of whole meshes."""
    monkeypatch.setattr("svbrdfgan.training.run.WHOLE", 32)
    settings = GeneratorConfig(width=4, blocks=1, kernel=3, norm="pixel", skips=True, random_fields=6)
    generator = make_generator(settings, labels=model.config.conditions.size).eval()
    initialise(generator, torch.Generator().manual_seed(0), "he")
    camera = CameraDistribution(close_ups=CloseUps(share=1.0, window=32))
    dataset = model.config.dataset.model_copy(update={"texture": 64, "camera": camera})
    return Model(generator, model.config.model_copy(update={"dataset": dataset}), None)


def test_the_same_words_paint_the_same_layer_and_others_another(mesh: Mesh, model: Model) -> None:
    def layer(**asked: Any) -> Tensor:
        return paint(mesh, model, **{"seed": 7, "amount": 0.4, "recipe": "rust"} | asked)[1].values

    assert layer().shape == (32, 32, 4)
    assert torch.equal(layer(), layer())
    for other in ({"seed": 8}, {"amount": 0.9}, {"recipe": "dust"}):
        assert not torch.equal(layer(**other), layer())


def test_by_default_it_is_seed_0_and_the_middle_amount(mesh: Mesh, model: Model) -> None:
    _, wanted = paint(mesh, model, seed=0, amount=0.6, recipe="dust")
    torch.testing.assert_close(paint(mesh, model, recipe="dust")[1].values, wanted.values, atol=1e-6, rtol=1e-6)


def test_amounts_that_it_never_saw_are_told(mesh: Mesh, model: Model, caplog: pytest.LogCaptureFixture) -> None:
    paint(mesh, model, amount=0.1, recipe="rust")
    assert "amount 0.1 is beyond those that the model was trained on: 0.2 to 1" in caplog.text


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"recipe": "rust", "seed": -1}, "seed -1 is not allowed; wanted a whole number from 0"),
        ({"recipe": "rust", "seed": 2**63}, "is not allowed; wanted a whole number from 0"),
        ({"recipe": "rust", "amount": 2.0}, "amount 2 is not allowed"),
        ({"recipe": "mud"}, "does not know the recipe 'mud'"),
    ],
)
def test_what_it_cannot_paint_is_told(asked: dict[str, Any], said: str, mesh: Mesh, model: Model) -> None:
    with pytest.raises(ConfigError, match=said):
        paint(mesh, model, **asked)


def test_a_model_without_chance_has_no_seeds(mesh: Mesh, model: Model) -> None:
    train = model.config.train
    plain = train.model_copy(update={"generator": train.generator.without_random_fields})
    config = model.config.model_copy(update={"train": plain})
    still = replace(model, generator=Generator(width=4, blocks=1), config=config)
    assert config.conditions == Conditions()
    for asked, said in (({"seed": 0}, "has no random fields"), ({"amount": 0.5}, "does not know amounts")):
        with pytest.raises(ConfigError, match=said):
            paint(mesh, still, **asked)
    assert paint(mesh, still)[1].values.shape == (32, 32, 4)


def test_at_the_trained_resolution_nothing_changes(mesh: Mesh, model: Model) -> None:
    asked: dict[str, Any] = {"seed": 7, "amount": 0.4, "recipe": "rust"}
    finer, plain = paint(mesh, model, **asked, resolution=32)[1], paint(mesh, model, **asked)[1]
    assert torch.equal(finer.values, plain.values)


def test_a_finer_layer_has_the_scale_of_the_coarse_one(mesh: Mesh, model: Model) -> None:
    def painted(resolution: int) -> tuple[Subject, Tensor]:
        subject, layer = paint(mesh, model, seed=7, recipe="rust", resolution=resolution)
        return subject, layer.values

    def power(subject: Subject, layer: Tensor) -> Tensor:
        """Of alpha, by octave, finest first."""
        weight = torch.where(subject.learnable_texels, subject.buffer.area, 0.0)
        return torch.stack([octave.power()[0] for octave in octaves(premultiplied(Layer(layer[None])), weight)])

    (subject, coarse), (finer_subject, finer) = painted(32), painted(128)
    assert finer.shape == (128, 128, 4)
    assert finer_subject.geometry.shape == (6, 128, 128)
    pooled = F.avg_pool2d(finer.permute(2, 0, 1), 4).permute(1, 2, 0)
    assert (pooled - coarse).abs().mean() < 0.1 * coarse.std(dim=(0, 1)).mean()
    ratio = power(finer_subject, finer)[2:] / power(subject, coarse)
    assert (ratio - 1.0).abs().max() < 0.3


def test_finer_layers_obey_seed_amount_and_recipe(mesh: Mesh, model: Model) -> None:
    def layer(**asked: Any) -> Tensor:
        return paint(mesh, model, **{"seed": 7, "amount": 0.4, "recipe": "rust", "resolution": 64} | asked)[1].values

    assert torch.equal(layer(), layer())
    for other in ({"seed": 8}, {"amount": 0.9}, {"recipe": "dust"}):
        assert not torch.equal(layer(**other), layer())


def test_a_model_of_windows_paints_whole_maps_finer_than_what_it_reads(mesh: Mesh, windowed: Model) -> None:
    """Equally at once and in tiles, and at twice the resolution with patterns of the same scale."""
    assert (windowed.geometry_texels, windowed.windows) == (32, Windows(32, 2))
    asked: dict[str, Any] = {"seed": 7, "recipe": "rust"}
    (subject, layer), (_, finer) = paint(mesh, windowed, **asked), paint(mesh, windowed, **asked, resolution=128)
    assert layer.values.shape == (64, 64, 4)
    assert subject.geometry.shape == (6, 64, 64)
    assert layer.values.std(dim=(0, 1)).min() > 0.01
    pooled = F.avg_pool2d(finer.values.permute(2, 0, 1), 2).permute(1, 2, 0)
    assert (pooled - layer.values).abs().mean() < 0.4 * layer.values.std(dim=(0, 1)).mean()
    with pytest.raises(ConfigError, match="resolution 32 is not allowed; the model was trained at 64 texels"):
        paint(mesh, windowed, **asked, resolution=32)


def test_a_model_of_windows_weathers_files(windowed: Model, van: Path) -> None:
    """All that any peel shows is painted."""
    workpiece = open_workpiece(van, learnable=("*",), front="+Z", up="+Y")
    weathering = LearnedWeathering.of(windowed, seed=7, recipe="rust")
    painter = weathering.painter(workpiece)
    assert isinstance(painter, LearnedPainter)
    assert [layer.factor for layer in painter.layers] == [2] * len(painter.layers)
    for peel, layer in zip(painter.embedded.peels, painter.layers, strict=True):
        known = np.repeat(np.repeat(peel.known, 2, axis=0), 2, axis=1).ravel()
        assert (layer.values[known].abs().sum(dim=1) > 0.0).all()


@pytest.mark.parametrize("resolution", [-32, 0, 16, 48, 8192])
def test_resolutions_that_it_cannot_paint_are_told(resolution: int, mesh: Mesh, model: Model) -> None:
    said = f"resolution {resolution} is not allowed; .* trained at 32 texels, .* a multiple of 32 from 32 to 4096."
    with pytest.raises(ConfigError, match=said):
        paint(mesh, model, recipe="rust", resolution=resolution)


@pytest.mark.parametrize("error", [MemoryError(), RuntimeError("DefaultCPUAllocator: can't allocate memory")])
def test_a_lack_of_memory_is_told(error: Exception, mesh: Mesh, model: Model, monkeypatch: pytest.MonkeyPatch) -> None:
    def lacking(self: Canvas, draw: Any) -> Layer:
        raise error

    monkeypatch.setattr(Canvas, "paint", lacking)
    with pytest.raises(ConfigError, match="not enough memory for resolution 64; choose a smaller one"):
        paint(mesh, model, recipe="rust", resolution=64)
    with pytest.raises(type(error)):  # no resolution was asked for, so none is to blame
        paint(mesh, model, recipe="rust")


def test_other_errors_stay_as_they_are() -> None:
    with pytest.raises(RuntimeError, match="something else"), explain_memory(64):
        raise RuntimeError("something else")
