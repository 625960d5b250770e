"""The oracle: told the truth, the network learns what can be learned."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from lightning_fabric import Fabric

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.oracle import Oracle, OracleConfig, train_oracle
from svbrdfgan.metrics.constant import best_constants
from svbrdfgan.metrics.recovered import Scorer, Target, make_targets, mean_error
from svbrdfgan.networks import Generator
from svbrdfgan.training.config import GeneratorConfig, TrainConfig

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
        targets.append(replace(target, truth=layer))
    geometry = torch.stack([subject.geometry for subject in tiny_exemplars.subjects])
    constant = best_constants(targets)[0].expand(2, 32, 32, 4)
    return targets, Scorer(geometry, targets, {"base_color": mean_error(targets, constant)})


def trained(toy: tuple[list[Target], Scorer], **schedule: float) -> tuple[Oracle, list[tuple[int, float]]]:
    (targets, scorer), seen = toy, []
    fabric = Fabric(accelerator="cpu", devices=1)
    oracle = train_oracle(
        fabric, CONFIG, scorer.geometry, targets, scorer, OracleConfig(**schedule), lambda *told: seen.append(told)
    )  # type: ignore[arg-type]
    return oracle, seen


@pytest.mark.full
def test_it_learns_a_simple_function_of_position(toy: tuple[list[Target], Scorer]) -> None:
    oracle, seen = trained(toy, rate=1e-2, every=20, steps=240)
    assert oracle.score > 0.5
    assert toy[1].recovered(oracle.generator) == pytest.approx(oracle.score)
    assert oracle.score == max(score for _, score in seen)
    assert [step for step, _ in seen] == list(range(20, oracle.steps + 1, 20))


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
