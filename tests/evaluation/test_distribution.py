"""The score of draws on a split: 1 for a generator that draws as the recipe does, and low for one frozen draw."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data import true_draws
from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.distribution import Comparison, _sweeps, compare_draws
from svbrdfgan.evaluation.evaluate import evaluate
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.inference.apply import choose_draw
from svbrdfgan.metrics.constant_layer import constant_layers
from svbrdfgan.metrics.draw_scorer import DrawScorer
from svbrdfgan.metrics.recovered import Scorer
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.training.run import load_model
from svbrdfgan.weathering.layer import recipe_from_options, weather
from svbrdfgan.weathering.survey import find_site

CPU = torch.device("cpu")
FABRIC = Fabric(accelerator="cpu", precision="32-true")
AMOUNTS = Conditions((0.4, 1.0), ("smooth-rust",))


@pytest.fixture(scope="module")
def dataset(dataset_data: Callable[..., dict[str, Any]], built_once: Any) -> Dataset:
    """One vehicle with textures that are fine enough for the score."""
    data = dataset_data(
        texture=64,
        image=[16, 16],
        spp=1,
        embedding={"resolution": 64},
        weathering={"recipe": "smooth-rust", "amount": {"uniform": [0.4, 1]}, "seed": {"uniform": [0, 9999]}},
        splits={"train": {"meshes": {"procedural": {"count": 1}}, "views": 4}, "validation": {"views": 1}},
    )
    return Dataset.open(built_once("draws", lambda f: generate(dataset_config(data, "here"), f, base=Path()) and None))


@pytest.fixture(scope="module")
def exemplars(dataset: Dataset) -> Exemplars:
    return load_exemplars(dataset, "train")


class Recipe:
    """Stands for a generator that has learned the recipe exactly."""

    maps = ()

    def __init__(self, exemplars: Exemplars, frozen: bool = False, bias: float = 0.0) -> None:
        self.subject, self.frozen, self.bias = exemplars.subjects[0], frozen, bias
        self.site = find_site(self.subject.surface, self.subject.buffer)

    def paint(self, inputs: Inputs, seeds: Tensor, labels: Tensor) -> Tensor:
        return torch.stack(
            [self.layer(int(seed), float(label)) for seed, label in zip(seeds, labels[:, 0], strict=True)]
        )

    def layer(self, seed: int, label: float) -> Tensor:
        amount = min(max((label + 1) / 2 + self.bias, 0.0), 1.0)
        recipe = recipe_from_options("smooth-rust", {"amount": amount, "seed": 77 if self.frozen else 10**6 + seed})
        return weather(self.subject.surface, self.subject.buffer, recipe, site=self.site).values


@pytest.fixture(scope="module")
def constants(exemplars: Exemplars) -> Tensor:
    return constant_layers(exemplars, seen, CPU)


@pytest.fixture(scope="module")
def scorer(exemplars: Exemplars, constants: Tensor) -> Scorer:
    return Scorer.make(exemplars, seen, constants, CPU)


@pytest.fixture(scope="module")
def score(dataset: Dataset, exemplars: Exemplars, scorer: Scorer, constants: Tensor) -> Callable[..., Comparison]:
    config: Any = SimpleNamespace(dataset=dataset.config, conditions=AMOUNTS)

    @cache
    def found(**fault: Any) -> Comparison:
        learned: Any = Recipe(exemplars, **fault)
        return compare_draws({"it": learned}, config, FABRIC, exemplars, scorer, constants)

    return found


def seen(index: int) -> Tensor:
    return torch.ones(64, 64)


@pytest.mark.full
def test_draws_of_the_recipe_resemble_it_and_others_do_not(score: Callable[..., Comparison]) -> None:
    learned = score().resemblance["it"]
    assert (learned.subjects, learned.draws) == (1, 16)
    assert learned.resemblance > 0.85, learned.lines()
    frozen = score(frozen=True).resemblance["it"]
    assert frozen.deviation < 0.5, frozen.lines()
    assert frozen.resemblance < 0.7 * learned.resemblance
    biased = score(bias=-0.3).resemblance["it"]
    assert biased.amount < 0.5 < 0.9 < learned.amount, biased.lines()


@pytest.mark.full
def test_training_scores_as_an_evaluation_does(
    dataset: Dataset, exemplars: Exemplars, scorer: Scorer, constants: Tensor, score: Callable[..., Comparison]
) -> None:
    declared = dataset.config.weathering
    assert declared is not None
    made = DrawScorer.make(exemplars, scorer, constants, declared, AMOUNTS, count=16, limit=8)
    learned: Any = Recipe(exemplars, bias=-0.3)
    found, wanted = made.score(learned, FABRIC), score(bias=-0.3).resemblance["it"]
    assert found.parts == pytest.approx(wanted.parts, rel=1e-4)


@pytest.mark.full
def test_figures_of_the_recipe_are_the_truths_and_others_are_off(score: Callable[..., Comparison]) -> None:
    learned = score().figures
    assert set(learned) == {"it", "truth"}
    assert learned["truth"].amount is None
    amount = learned["it"].amount
    assert amount is not None
    assert amount.correlation > 0.95
    assert amount.error < 0.03
    for figures in learned.values():
        assert 0.8 < figures.deviation < 1.25
        assert figures.mean_correlation > 0.7
        assert all(0.6 < ratio < 1.6 for ratio in figures.power), figures.line()
    assert score(frozen=True).figures["it"].deviation < 0.8
    biased = score(bias=-0.3).figures["it"].amount
    assert biased is not None
    assert biased.error > 2 * amount.error
    assert biased.correlation > 0.9, "it has too little, but more where more is asked for"


def test_a_run_with_chance_has_the_score_in_its_record_and_paints_exemplars_as_they_are(
    varied_run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(true_draws, "_POINTS", 128)
    evaluated = evaluate(varied_run, split="validation", device="cpu", oracle=False)
    model = load_model(varied_run)
    for index, scene in enumerate(evaluated.source.exemplars.scenes):
        weathering: Any = scene.weathering
        draw = choose_draw(model, amount=weathering.amount, recipe=weathering.recipe)
        layer = draw.on(evaluated.source.inputs([index]))[0]
        torch.testing.assert_close(evaluated.layers_of(index)["generated"].values, layer, atol=1e-3, rtol=0)
        assert not torch.equal(layer, evaluated.layers["generated"][0]), "that has the middle amount"
    found = evaluated.evaluation
    draws = found.generated.draws
    assert draws is not None
    assert draws.draws == 16
    assert draws.lines()[0] in found.lines()
    figures = found.generated.figures
    assert figures is not None
    assert figures.relit is not None
    assert figures.relit.pairs == 4
    assert figures.line() in "\n".join(found.lines())
    assert found.truth.figures is not None
    assert found.truth.figures.relit is None
    assert Evaluation.model_validate_json((varied_run / "evaluation.validation.json").read_text()) == found


def test_draws_that_cannot_be_compared_have_no_score(
    varied_run: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise AssetError("too small")

    monkeypatch.setattr("svbrdfgan.evaluation.evaluate.compare_draws", refuse)
    found = evaluate(varied_run, split="validation", device="cpu", oracle=False).evaluation
    assert found.generated.resemblance is found.generated.figures is found.truth.figures is None
    assert "resemblance has no score: too small" in caplog.text
    assert found.of_distribution
    assert found.refusal == "too small"


def test_one_window_of_each_mesh_is_painted_at_all_amounts() -> None:
    meshes = ["a.glb", "b.glb", "a.glb", "b.glb"]
    scenes = [SimpleNamespace(mesh=SimpleNamespace(path=path)) for path in meshes]
    windows: Any = SimpleNamespace(scenes=scenes, views_of=lambda number: [number])
    run: Any = SimpleNamespace(conditions=AMOUNTS)
    sweeps = _sweeps(run, windows, [0, 2, 3])
    assert [bool(each) for each in sweeps.values()] == [True, False, True]
    ((recipe, amounts),) = sweeps[3]
    assert recipe == "smooth-rust"
    assert amounts[0] == pytest.approx(0.4)
    assert amounts[-1] == 1.0
