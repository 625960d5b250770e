"""The verdict on a run."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.generate import generate
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.evaluated import Evaluated, pictures
from svbrdfgan.evaluation.oracle import OracleConfig
from svbrdfgan.evaluation.record import ConstantScores, Evaluation, LearnedScores, OracleScores, PainterScores
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
    best = verdict.oracle
    assert best is not None
    assert verdict.fraction == (verdict.generated.recovered / best.recovered if best.recovered > 0 else None)
    assert best.validation == pytest.approx(best.recovered, abs=1e-4)  # the split that is scored here
    assert (best.steps, best.plateau) == (20, False)
    assert 0 < verdict.seen < 1


def test_the_truth_looks_like_the_exemplars_but_for_noise(evaluated: Evaluated) -> None:
    verdict = evaluated.evaluation
    assert 0 < verdict.truth.flip < min(verdict.generated.flip, verdict.constant.flip)


def test_a_run_is_relit(evaluated: Evaluated) -> None:
    """Two scenes of the one vehicle, whose layer is not the truth in any light. base_color alone needs no table."""
    verdict = evaluated.evaluation
    assert len(evaluated.relit) == 2
    relit = {painter: scores.relit_flip for painter, scores in verdict.painters.items()}
    assert 0 < relit["truth"] < relit["generated"]
    assert verdict.relit_ratio == relit["generated"] / relit["oracle"]
    shown = [scene.flips() for scene in evaluated.relit]
    assert relit == pytest.approx({painter: sum(flips[painter] for flips in shown) / 2 for painter in relit})
    assert verdict.map_table() == {}


def test_pictures_have_the_samples_of_the_exemplars(
    training_data: Callable[..., dict[str, Any]], evaluated: Evaluated, tmp_path: Path
) -> None:
    """Whatever a run trained with, FLIP of its rows can be compared."""
    train(train_config(training_data(spp=1, steps=1), "here"), tmp_path)
    noisy = evaluate(tmp_path, split="validation", oracle=False, device="cpu")
    assert noisy.evaluation.truth.flip == evaluated.evaluation.truth.flip


def test_the_validation_score_is_that_of_training(run: Path, evaluated: Evaluated) -> None:
    history = json.loads((sorted((run / "checkpoints").iterdir())[-1] / "state.json").read_text())["history"]
    assert evaluated.evaluation.generated.recovered == pytest.approx(
        max(entry["recovered"] for entry in history), abs=1e-5
    )


def test_layers_are_painted_on_every_subject(evaluated: Evaluated) -> None:
    assert set(evaluated.layers) == {"generated", "oracle", "constant"}
    for layers in evaluated.layers.values():
        assert layers.shape == (1, 32, 32, 4)
    constant = evaluated.layers["constant"].reshape(-1, 4)
    assert (constant == constant[0]).all()
    assert constant[0].tolist() == pytest.approx(evaluated.evaluation.constant.layer)


def test_pictures_show_the_same_scene_under_each_layer(evaluated: Evaluated) -> None:
    layers = evaluated.layers_of(1)
    assert set(layers) == {"generated", "oracle", "constant", "truth"}
    shown = dict(zip(layers, pictures(evaluated.source, 1, layers.values()), strict=True))
    bare = evaluated.source.fake_scenes._stored((1, 0)).coverage == 0  # type: ignore[attr-defined]
    for picture in shown.values():
        assert picture.shape == (32, 32, 3)
        assert torch.equal(picture[bare], shown["truth"][bare])


class Phases:
    """Keeps the name, the total and the steps of each phase."""

    def __init__(self) -> None:
        self.seen: list[tuple[str, int | None, int]] = []

    def begin(self, what: str, total: int | None = None, done: int = 0) -> None:
        self.seen.append((what, total, 0))

    def advance(self, steps: int = 1, note: str = "") -> None:
        what, total, done = self.seen[-1]
        self.seen[-1] = what, total, done + steps


@pytest.mark.parametrize("maps", [{}, {"roughness": 0.4}])
def test_every_phase_ends_at_its_total(
    maps: dict[str, float],
    dataset_data: Callable[..., dict[str, Any]],
    training_data: Callable[..., dict[str, Any]],
    tmp_path: Path,
) -> None:
    """Scenes of the training split are looked at again for the oracle, which is a phase of its own."""
    made = dataset_data(maps=maps, weathering={"recipe": "dust", "seed": {"uniform": [0, 99]}})
    generate(dataset_config(made, "here"), tmp_path / "dataset", base=Path())
    chance = {"random_fields": 3}
    train(train_config(training_data(dataset=str(tmp_path / "dataset"), generator=chance), "here"), tmp_path / "run")
    phases = Phases()
    evaluate(tmp_path / "run", split="validation", device="cpu", display=phases)
    assert [phase for phase in phases.seen if phase[1] is not None and phase[2] != phase[1]] == []
    names = [what for what, _, _ in phases.seen]
    oracle = names.index("training the oracle on true layers")
    assert names[oracle - 1] == "light transport of the train scenes"
    assert phases.seen[oracle - 1][2] == 6, "every scene of the split is traced"


def test_the_oracle_is_trained_once(run: Path, evaluated: Evaluated) -> None:
    written = (run / "oracle.safetensors").stat().st_mtime_ns
    again = evaluate(run, split="validation", device="cpu", schedule=OracleConfig(steps=1))
    assert (run / "oracle.safetensors").stat().st_mtime_ns == written
    assert again.evaluation.oracle.recovered == pytest.approx(evaluated.evaluation.oracle.recovered, abs=1e-4)
    assert again.evaluation.oracle.steps == 20


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
    assert verdict.oracle is verdict.fraction is None


def test_what_is_told() -> None:
    verdict = Evaluation(
        split="test",
        subjects=3,
        exemplars=6,
        areas={"base_color": 0.75},
        generated=LearnedScores(recovered=0.5, flip=0.1),
        oracle=OracleScores(recovered=0.8, flip=0.05, steps=300, plateau=True),
        constant=ConstantScores(flip=0.2, layer=(0, 0, 0, 0)),
        truth=PainterScores(flip=0.02),
    )
    told = "\n".join(verdict.lines())
    for word in ("0.500", "0.800", "0.625", "at its plateau after 300 steps", "75%", "3 test subjects"):
        assert word in told


def test_a_run_without_a_model_is_told(run: Path, tmp_path: Path) -> None:
    shutil.copytree(run, tmp_path / "copy")
    (tmp_path / "copy" / "model.safetensors").unlink()
    with pytest.raises(AssetError, match="train the run until it has saved a model"):
        evaluate(tmp_path / "copy", split="validation", device="cpu")


def test_a_run_is_scored_on_another_data_set(
    run: Path, tmp_path: Path, varied_dataset: Path, dataset_data: Callable[..., dict[str, Any]]
) -> None:
    copied = shutil.copytree(run, tmp_path / "run", ignore=shutil.ignore_patterns("oracle.*"))
    evaluated = evaluate(copied, split="validation", device="cpu", on=varied_dataset)
    assert evaluated.config.dataset_folder == str(varied_dataset.resolve())
    assert evaluated.evaluation.of_distribution, "the layers of that data set are one"
    assert evaluated.evaluation.oracle is None
    assert not (copied / "oracle.json").exists()
    own = evaluate(run, split="validation", device="cpu", oracle=False).evaluation
    data = dataset_data(seed=5, splits={"train": {"views": 1}, "test": {"meshes": {"procedural": {"count": 1}}}})
    generate(dataset_config(data, "here"), tmp_path / "other", base=tmp_path)
    other = evaluate(copied, split="validation", device="cpu", on=tmp_path / "other").evaluation
    assert not other.of_distribution
    assert other.generated.recovered != own.generated.recovered, "its pictures show other vehicles"


def test_a_data_set_that_cannot_score_a_run_is_told(
    run: Path,
    varied_run: Path,
    tiny_dataset: Path,
    tmp_path: Path,
    dataset_data: Callable[..., dict[str, Any]],
) -> None:
    with pytest.raises(ConfigError, match="must vary likewise"):
        evaluate(varied_run, split="validation", device="cpu", on=tiny_dataset)
    generate(dataset_config(dataset_data(maps={"roughness": 0.4}), "here"), tmp_path / "glossy", base=tmp_path)
    with pytest.raises(ConfigError, match=r"paints base_color, and the layers of .*glossy have base_color, roughness"):
        evaluate(run, split="validation", device="cpu", on=tmp_path / "glossy")
