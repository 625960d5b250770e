"""The oracle of a distribution: what its discriminator sees, what it learns, and that evaluation trains it."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.conditions import labels_of_scenes
from svbrdfgan.data.exemplars import load_exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError, TrainingError
from svbrdfgan.evaluation.adversarial_oracle import Budget, TrueLayers, train_adversarial_oracle
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import Evaluation, share
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.saved import load_generator, make_generator, save_generator
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.training.metrics_log import read_metrics
from svbrdfgan.training.run import LOG, ORACLE, ORACLE_NOTES, RunConfig
from svbrdfgan.training.trainer import train
from svbrdfgan.types import Layer

CPU = torch.device("cpu")
SIZE = 32
CONFIG = TrainConfig.model_validate(
    {
        "dataset": "none",
        "batch_size": 4,
        "generator": {"width": 4, "blocks": 1, "random_fields": 2},
        "discriminator": {"width": 8, "layers": 1},
        "optimizer": {"generator_rate": 2e-3, "discriminator_rate": 5e-3, "ema_images": 200},
    }
)


@pytest.fixture
def fabric() -> Fabric:
    return Fabric(accelerator="cpu", precision="32-true")


@pytest.fixture
def even() -> TrueLayers:
    """Layers that are even: alpha is the amount. The lower half of the texture is not shown."""
    amounts = torch.linspace(0.1, 0.9, 16)
    layers = torch.tensor([0.4, 0.2, 0.1, 1.0]).repeat(16, SIZE, SIZE, 1)
    layers[..., 3] = amounts[:, None, None]
    shown = torch.zeros(2, SIZE, SIZE, dtype=torch.bool)
    shown[:, SIZE // 2 :] = True
    geometry = torch.randn(2, 6, SIZE, SIZE, generator=torch.Generator().manual_seed(0))
    return TrueLayers(
        geometry, shown, Layer(layers.half()), torch.arange(16) % 2, 2 * amounts[:, None] - 1, gbuffer=True
    )


def generator_of(truth: TrueLayers) -> Generator:
    labels = 0 if truth.labels is None else truth.labels.shape[1]
    return Generator(width=4, blocks=1, random_fields=2, labels=labels, maps=truth.layers.maps)


def test_the_discriminator_sees_the_layers_where_pictures_show_them(even: TrueLayers, fabric: Fabric) -> None:
    batch = even.batch(fabric, generator_of(even), [1, 14], np.random.default_rng(0))
    assert batch.real.shape == batch.fake.shape == (2, 4 + 6 + 1, SIZE, SIZE)
    for side in (batch.real, batch.fake):
        assert torch.equal(side[:, :, : SIZE // 2], torch.zeros_like(side[:, :, : SIZE // 2]))
        assert torch.equal(side[:, 4:10, SIZE // 2 :], even.geometry[[1, 0], :, SIZE // 2 :])
    assert batch.real[:, 0, -1, -1].tolist() == pytest.approx([2 * a - 1 for a in (0.1533, 0.8467)], abs=1e-3)
    assert batch.real[:, 10, -1, -1].tolist() == pytest.approx([2 * a - 1 for a in (0.1533, 0.8467)], abs=1e-3)
    assert torch.equal(batch.real[:, 10], batch.fake[:, 10])
    red = batch.real[0, 1, -1, -1]
    assert float(red) == pytest.approx(2 * np.log1p(10 * 0.4 * 0.1533) / np.log(11) - 1, abs=1e-3)


def test_what_is_not_shown_teaches_nothing(even: TrueLayers, fabric: Fabric) -> None:
    painted = torch.rand(2, SIZE, SIZE, 4, requires_grad=True)

    def stub(*_: Tensor) -> Tensor:
        return painted

    stub.random_fields = 0  # type: ignore[attr-defined]
    even.batch(fabric, stub, [0, 1], np.random.default_rng(0)).fake.square().sum().backward()  # type: ignore[arg-type]
    assert painted.grad is not None
    assert not painted.grad[:, : SIZE // 2].any()
    assert painted.grad[:, SIZE // 2 :].any()


def test_further_maps_are_judged_and_labels_may_be_missing(even: TrueLayers, fabric: Fabric) -> None:
    further = torch.full((16, SIZE, SIZE, 4), 0.5).half()  # roughness and normal
    layers = Layer(torch.cat([even.layers.values, further], dim=-1), ("roughness", "normal"))
    whole = replace(even, layers=layers, labels=None, gbuffer=False)
    batch = whole.batch(fabric, generator_of(whole), [0, 1, 2], np.random.default_rng(0))
    assert batch.real.shape == (3, whole.judged, SIZE, SIZE) == (3, 4 + 1 + 2, SIZE, SIZE)


@pytest.mark.full
def test_it_learns_to_obey_the_amount(even: TrueLayers, fabric: Fabric) -> None:
    told: list[int] = []
    oracle, steps = train_adversarial_oracle(fabric, CONFIG, even, Budget(500), told.append)
    assert steps == sum(told) == 500
    labels = torch.tensor([[-0.6], [0.6]])
    with torch.no_grad():
        little, much = oracle(even.geometry, torch.tensor([5, 5]), labels)[:, SIZE // 2 :, :, 3].mean(dim=(1, 2))
    assert abs(little - 0.2) < 0.15
    assert abs(much - 0.8) < 0.15


def test_the_same_seed_is_the_same_oracle(even: TrueLayers, fabric: Fabric) -> None:
    one, other = (train_adversarial_oracle(fabric, CONFIG, even, Budget(3))[0].state_dict() for _ in range(2))
    assert all(torch.equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("shown", ["light_buffer", "clean_picture", "pixel_size"])
def test_what_only_pictures_have_is_not_shown(even: TrueLayers, fabric: Fabric, shown: str) -> None:
    discriminator = CONFIG.discriminator.model_copy(update={shown: True})
    config = CONFIG.model_copy(update={"discriminator": discriminator})
    assert train_adversarial_oracle(fabric, config, even, Budget(1))[1] == 1


def test_time_ends_it(even: TrueLayers, fabric: Fabric) -> None:
    assert train_adversarial_oracle(fabric, CONFIG, even, Budget(10**6, minutes=1e-9))[1] <= 1


def test_losses_that_are_not_finite_are_reported(even: TrueLayers, fabric: Fabric) -> None:
    broken = replace(even, layers=Layer(torch.full_like(even.layers.values, torch.nan)))
    with pytest.raises(TrainingError, match="the oracle stopped at step 2: a loss or weight is not finite"):
        train_adversarial_oracle(fabric, CONFIG, broken, Budget(2))


def test_it_learns_from_as_many_layers_as_there_are_exemplars(varied_run: Path) -> None:
    config = RunConfig.load(varied_run)
    exemplars = load_exemplars(Dataset.open(Path(config.dataset_folder)), "train")
    truth = TrueLayers.of(exemplars, lambda index: torch.ones(SIZE, SIZE), config, CPU)
    assert len(truth) == len(exemplars) == 6
    assert truth.subject_of.tolist() == exemplars.subject_of.tolist()
    for number, subject in enumerate(exemplars.subjects):
        assert not truth.shown[number][~subject.learnable_texels].any()
    assert truth.labels is not None
    assert torch.equal(truth.labels, labels_of_scenes(config.conditions, exemplars.scenes))
    for index, layer in enumerate(truth.layers.values):
        assert torch.equal(layer, exemplars.layers[index].values.half())
    with pytest.raises(AssetError, match="nothing to learn from"):
        TrueLayers.of(exemplars, lambda index: torch.zeros(SIZE, SIZE), config, CPU)


@pytest.mark.full
def test_evaluation_trains_it_for_a_run_that_learns_a_distribution(varied_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(varied_run, tmp_path / "run")
    found = evaluate(run, split="validation", device="cpu").evaluation
    best = found.oracle
    assert best is not None
    assert best.steps == 4  # as the run
    assert best.plateau is best.validation is found.fraction is None
    assert best.draws is not None
    assert found.resemblance_fraction == share(found.generated.resemblance, best.resemblance)
    drawn = {painter for painter, scores in found.painters.items() if scores.figures is not None}
    assert drawn == {"generated", "oracle", "truth"}
    assert any(line.startswith("oracle: ") for line in found.lines())
    assert Evaluation.model_validate_json((run / "evaluation.validation.json").read_text()) == found
    generator, score = load_generator(run / ORACLE)
    assert generator.random_fields == 3
    assert score is None
    written = (run / ORACLE).stat().st_mtime_ns
    again = evaluate(run, split="validation", device="cpu").evaluation
    assert again.oracle is not None
    assert again.oracle.steps == 4
    assert again.oracle.resemblance == pytest.approx(best.resemblance, abs=1e-3)
    assert (run / ORACLE).stat().st_mtime_ns == written


@pytest.mark.full
def test_a_run_that_was_continued_has_its_oracle_trained_anew(varied_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(varied_run, tmp_path / "run")
    assert evaluate(run, split="validation", device="cpu").evaluation.oracle.steps == 4
    last = read_metrics(run)[-1]
    with (run / LOG).open("a") as log:
        log.write(json.dumps({**last, "step": 6}) + "\n")
    for _ in range(2):
        assert evaluate(run, split="validation", device="cpu").evaluation.oracle.steps == 6


@pytest.mark.full
def test_an_oracle_of_an_earlier_version_is_not_taken_for_it(varied_run: Path, tmp_path: Path) -> None:
    run = shutil.copytree(varied_run, tmp_path / "run")
    earlier = RunConfig.load(run).train.generator.without_random_fields
    save_generator(run / ORACLE, make_generator(earlier), earlier, 0.1)
    (run / ORACLE_NOTES).write_text(json.dumps({"plateau": True, "steps": 300}))
    assert evaluate(run, split="validation", device="cpu").evaluation.oracle.draws is not None


@pytest.mark.full
def test_where_seeds_are_fixed_the_oracle_is_supervised(
    training_data: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    train(train_config(training_data(generator={"random_fields": 2}, steps=1), "here"), tmp_path)
    quick = OracleConfig(rate=1e-2, every=10, steps=10)
    found = evaluate(tmp_path, split="validation", device="cpu", schedule=quick).evaluation
    assert found.oracle is not None
    assert found.oracle.plateau is False
    assert found.fraction == share(found.generated.recovered, found.oracle.recovered)
    assert found.oracle.draws is None
    assert load_generator(tmp_path / ORACLE)[0].random_fields == 0
