"""The oracle: told the truth, the network learns what can be learned."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from lightning_fabric import Fabric

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.oracle import Oracle, OracleConfig, _weights, train_oracle
from svbrdfgan.metrics.constant_layer import best_constants
from svbrdfgan.metrics.recovered import Scorer, Target, make_targets, mean_error, mean_errors
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.types import Layer

CONFIG = TrainConfig(dataset="none", batch_size=2, generator=GeneratorConfig(width=4, blocks=1, norm="group"))


@pytest.fixture(scope="module")
def toy(tiny_exemplars: Exemplars) -> tuple[list[Target], Scorer]:
    """Mud up to half the height: a simple function of position."""
    exact, _ = make_targets(tiny_exemplars, lambda index: torch.ones(32, 32), torch.device("cpu"))
    targets = []
    for target in exact:
        height = tiny_exemplars.subjects[target.subject].geometry[1]
        layer = torch.stack(
            [torch.full_like(height, c) for c in (0.3, 0.2, 0.1)] + [torch.sigmoid(-4 * height)], dim=-1
        )
        targets.append(replace(target, truth=Layer(layer)))
    inputs = Inputs.joined([subject.inputs for subject in tiny_exemplars.subjects])
    constant = best_constants(targets)[0].expand(2, 32, 32, 4)
    return targets, Scorer(inputs, targets, {"base_color": mean_error(targets, constant)})


def trained(toy: tuple[list[Target], Scorer], **schedule: float) -> tuple[Oracle, list[tuple[int, float]]]:
    (targets, scorer), seen = toy, []
    fabric, geometry = Fabric(accelerator="cpu", devices=1), scorer.inputs.geometry
    oracle = train_oracle(
        fabric,
        CONFIG,
        geometry,
        targets,
        scorer,
        OracleConfig(**schedule),
        lambda *told: seen.append(told),  # type: ignore[arg-type]
    )
    return oracle, seen


@pytest.mark.full
def test_it_learns_a_simple_function_of_position(toy: tuple[list[Target], Scorer]) -> None:
    oracle, seen = trained(toy, rate=1e-2, every=20, steps=240)
    assert oracle.score > 0.5
    assert toy[1].recovered_by(toy[1].layers(oracle.generator.paint)) == pytest.approx(oracle.score)
    assert oracle.score == max(score for _, score in seen)
    assert [step for step, _ in seen] == list(range(20, oracle.steps + 1, 20))


def test_maps_count_relative_to_their_constants() -> None:
    """In units of base_color's, which alone is learned as ever. A map that is constant does not drown the rest."""
    assert _weights({"base_color": 0.013}, torch.device("cpu")).tolist() == [1.0]
    errors = {"base_color": 0.1, "roughness": 0.05, "metallic": 1e-9, "normal": 4.0}
    assert _weights(errors, torch.device("cpu")).tolist() == pytest.approx([1.0, 2.0, 100.0, 0.025])


def test_further_maps_are_learned_and_decide(toy: tuple[list[Target], Scorer]) -> None:
    """Metal where the mud is: it has to be learned beside its color, and the score is the mean of both."""
    targets = [
        replace(
            target,
            truth=Layer(torch.cat([target.truth.values, torch.full((32, 32, 1), 0.9)], dim=-1), ("metallic",)),
            base={**target.base, "metallic": torch.zeros(32, 32, 1)},
        )
        for target in toy[0]
    ]
    errors = {
        name: mean_errors(targets, row.expand(2, 32, 32, 5))[n]
        for n, (name, row) in enumerate(zip(targets[0].names, best_constants(targets), strict=True))
    }
    scorer = Scorer(toy[1].inputs, targets, errors)
    oracle, seen = trained((targets, scorer), rate=1e-2, every=20, steps=60)
    each = scorer.each_recovered_by(scorer.layers(oracle.generator.paint))
    assert each["metallic"] is not None
    assert each["metallic"] > 0.2
    assert oracle.score == pytest.approx(sum(value or 0.0 for value in each.values()) / 2)
    assert oracle.score == max(score for _, score in seen)


def test_it_says_that_it_reached_its_plateau(toy: tuple[list[Target], Scorer]) -> None:
    """A rate that moves nothing: patience + 1 scores, then one halving for each `patience` more."""
    oracle, seen = trained(toy, rate=1e-12, every=1, patience=2, halvings=1, steps=50)
    assert oracle.plateau
    assert oracle.steps == len(seen) == 5


def test_it_says_that_it_did_not(toy: tuple[list[Target], Scorer]) -> None:
    oracle, _ = trained(toy, rate=1e-2, every=5, steps=10)
    assert not oracle.plateau
    assert oracle.steps == 10
    assert isinstance(oracle.generator, Generator)


def test_the_same_seed_is_the_same_oracle(toy: tuple[list[Target], Scorer]) -> None:
    one, other = (trained(toy, rate=1e-2, every=5, steps=10)[0].generator.state_dict() for _ in range(2))
    assert all(torch.equal(one[name], other[name]) for name in one)
