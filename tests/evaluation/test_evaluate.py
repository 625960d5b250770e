"""The verdict on a run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.evaluate import Evaluated, evaluate, pictures
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import Evaluation, share
from svbrdfgan.training.config import train_config
from svbrdfgan.training.trainer import train

QUICK = OracleConfig(rate=1e-2, every=10, steps=20)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, training_data: Callable[..., dict[str, Any]]) -> Path:
    folder = tmp_path_factory.mktemp("run") / "run"
    train(train_config(training_data(), "here"), folder)
    return folder


@pytest.fixture(scope="module")
def evaluated(run: Path) -> Evaluated:
    return evaluate(run, split="validation", device="cpu", schedule=QUICK)


def test_the_verdict_is_written_down(run: Path, evaluated: Evaluated) -> None:
    verdict = evaluated.evaluation
    assert not (run / "evaluation.json").exists()  # which is of the test split
    assert Evaluation.model_validate_json((run / "evaluation.validation.json").read_text()) == verdict
    assert (verdict.split, verdict.subjects, verdict.exemplars) == ("validation", 1, 2)
    assert verdict.oracle is not None
    assert verdict.fraction == share(verdict.recovered, verdict.oracle)
    assert verdict.oracle_validation == pytest.approx(verdict.oracle, abs=1e-4)  # the split that is scored here
    assert verdict.oracle_steps == 20
    assert verdict.oracle_plateau is False
    assert 0 < verdict.seen < 1


def test_the_truth_looks_like_the_exemplars_but_for_noise(evaluated: Evaluated) -> None:
    verdict = evaluated.evaluation
    assert 0 < verdict.flip_truth < min(verdict.flip, verdict.flip_constant)


def test_a_run_is_relit(evaluated: Evaluated) -> None:
    """Two scenes of the one vehicle, whose layer is not the truth in any light. base_color alone needs no table."""
    verdict = evaluated.evaluation
    assert len(evaluated.relit) == 2
    assert verdict.relit_flip is not None
    assert verdict.relit_flip_truth is not None
    assert 0 < verdict.relit_flip_truth < verdict.relit_flip
    assert verdict.relit_ratio == share(verdict.relit_flip, verdict.relit_flip_oracle)
    shown = [scene.flips() for scene in evaluated.relit]
    assert verdict.relit_flip_oracle == pytest.approx(sum(flips["oracle"] for flips in shown) / 2)
    assert verdict.maps == {}


def test_pictures_have_the_samples_of_the_exemplars(
    training_data: Callable[..., dict[str, Any]], evaluated: Evaluated, tmp_path: Path
) -> None:
    """Whatever a run trained with, FLIP of its rows can be compared."""
    train(train_config(training_data(spp=1, steps=1), "here"), tmp_path)
    noisy = evaluate(tmp_path, split="validation", oracle=False, device="cpu")
    assert noisy.evaluation.flip_truth == evaluated.evaluation.flip_truth


def test_the_validation_score_is_that_of_training(run: Path, evaluated: Evaluated) -> None:
    history = json.loads((sorted((run / "checkpoints").iterdir())[-1] / "state.json").read_text())["history"]
    assert evaluated.evaluation.recovered == pytest.approx(max(entry["recovered"] for entry in history), abs=1e-5)


def test_layers_are_painted_on_every_subject(evaluated: Evaluated) -> None:
    assert set(evaluated.layers) == {"generated", "oracle", "constant"}
    for layers in evaluated.layers.values():
        assert layers.shape == (1, 32, 32, 4)
    constant = evaluated.layers["constant"].reshape(-1, 4)
    assert (constant == constant[0]).all()
    assert constant[0].tolist() == pytest.approx(evaluated.evaluation.constant)


def test_pictures_show_the_same_scene_under_each_layer(evaluated: Evaluated) -> None:
    shown = pictures(evaluated.source, 1, evaluated.layers_of(1))
    assert set(shown) == {"generated", "oracle", "constant", "truth"}
    bare = evaluated.source.fake_scenes._stored((1, 0)).coverage == 0  # type: ignore[attr-defined]
    for picture in shown.values():
        assert picture.shape == (32, 32, 3)
        assert torch.equal(picture[bare], shown["truth"][bare])


def test_the_oracle_is_trained_once(run: Path, evaluated: Evaluated) -> None:
    written = (run / "oracle.safetensors").stat().st_mtime_ns
    again = evaluate(run, split="validation", device="cpu", schedule=OracleConfig(steps=1))
    assert (run / "oracle.safetensors").stat().st_mtime_ns == written
    assert again.evaluation.oracle == pytest.approx(evaluated.evaluation.oracle, abs=1e-4)
    assert again.evaluation.oracle_steps == 20


def test_lights_of_the_training_need_not_be_found_again(
    training_data: Callable[..., dict[str, Any]], dataset_copy: Path, tmp_path: Path
) -> None:
    """A run may be scored from anywhere: only the exemplars' own scenes matter."""
    (tmp_path / "lights").mkdir()
    light = next((dataset_copy / "assets" / "environments").iterdir())
    shutil.copy(light, tmp_path / "lights" / "lamp.exr")
    scenes = {"environment": {"files": ["lights/*.exr"]}}
    config = train_config(training_data(dataset=str(dataset_copy), steps=1, scenes=scenes), "here")
    train(config, tmp_path / "run", base=tmp_path)
    shutil.rmtree(tmp_path / "lights")
    verdict = evaluate(tmp_path / "run", split="validation", oracle=False, device="cpu").evaluation
    assert verdict.oracle is verdict.fraction is verdict.oracle_plateau is None


def test_what_is_told() -> None:
    verdict = Evaluation(
        split="test", recovered=0.5, oracle=0.8, fraction=0.625, oracle_plateau=True, oracle_steps=300, flip=0.1,
        flip_oracle=0.05, flip_constant=0.2, flip_truth=0.02, seen=0.75, constant=(0, 0, 0, 0), subjects=3, exemplars=6,
    )  # fmt: skip
    told = "\n".join(verdict.lines())
    for word in ("0.500", "0.800", "0.625", "at its plateau after 300 steps", "75%", "3 test subjects"):
        assert word in told


def test_a_run_without_a_model_is_told(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "copy")
    (tmp_path / "copy" / "model.safetensors").unlink()
    with pytest.raises(AssetError, match="train the run until it has saved a model"):
        evaluate(tmp_path / "copy", split="validation", device="cpu")
