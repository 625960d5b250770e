"""The oracle: the same network on the same data, taught by the true layers; a ceiling for the GAN.

The oracle is supervised. Where layers are a distribution, it is trained adversarially (`adversarial_oracle`).
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.config import Split
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.adversarial_oracle import Budget, TrueLayers, train_adversarial_oracle
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.metrics.map_errors import LEAST_ERRORS
from svbrdfgan.metrics.recovered import Scorer, SeenTexels, Target, make_targets
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.layers import initialise
from svbrdfgan.networks.saved import load_generator, make_generator, save_generator
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.metrics_log import read_metrics
from svbrdfgan.training.resolve import learns_distribution
from svbrdfgan.training.run import ORACLE, ORACLE_NOTES, RunConfig
from svbrdfgan.training.subject_inputs import stack_inputs
from svbrdfgan.utils.display import Display

LoadedSplit = tuple[Exemplars, SeenTexels]
"""A split, and what its pictures show of each texel."""
Watch = Callable[[int, float], None]
"""Called with the step and the validation score at every scoring."""

_TARGETS = 2048  # the most that it trains on
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class OracleConfig:
    """The schedule of the oracle's training: to its best, independent of the run's batch size and learning rates.

    Attributes:
        batch: targets in a step.
        rate: Adam's learning rate, halved whenever the score stalls.
        every: steps between scores.
        patience: scores without an improvement of `gain` before the rate is halved.
        halvings: halvings of the rate after which the plateau is reached.
        steps: the most steps, plateau or not.
    """

    batch: int = 16
    rate: float = 1e-3
    every: int = 100
    patience: int = 2
    gain: float = 0.003
    halvings: int = 2
    steps: int = 20000


@dataclass(frozen=True, eq=False)
class Oracle:
    """An oracle, trained now or in an earlier evaluation.

    Attributes:
        score: on the validation split; None of an adversarial one.
        plateau: whether a supervised one had stopped improving; None of an adversarial one.
        run_steps: the steps that the run had made when an adversarial one was trained as long; else None.
    """

    generator: Generator
    score: float | None
    steps: int
    plateau: bool | None
    run_steps: int | None = None

    @property
    def adversarial(self) -> bool:
        """Whether the oracle draws, and so is compared by `resemblance`."""
        return self.generator.random_fields > 0


class _Notes(StrictModel):
    """What is stored beside an oracle's generator; see `Oracle`."""

    plateau: bool | None
    steps: int
    run_steps: int | None = None


def train_oracle(
    fabric: Fabric,
    config: TrainConfig,
    geometry: Float[Tensor, "subjects inputs rows cols"],
    targets: list[Target],
    scorer: Scorer,
    schedule: OracleConfig,
    watch: Watch | None = None,
) -> Oracle:
    """Minimises E of every map on the training targets until the score of `scorer` stops rising.

    The error of a map counts relative to its constant layer's, as in `recovered`, in units of base_color's. The oracle
    has neither random fields nor conditions: where the truth varies it learns one layer between the true ones.
    """
    generator = make_generator(config.generator.without_random_fields, targets[0].truth.maps)
    initialise(generator, torch.Generator().manual_seed(config.seed))
    generator.to(geometry.device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it
    adam = torch.optim.Adam(generator.parameters(), schedule.rate, betas=(0.9, 0.99), fused=True)
    rng = np.random.default_rng([config.seed, 1])
    weights = _weights(scorer.constant_errors, geometry.device)
    best, best_score, stalled, halved = copy.deepcopy(generator), -float("inf"), 0, 0
    for step in range(1, schedule.steps + 1):
        picked = [targets[int(i)] for i in rng.integers(len(targets), size=schedule.batch)]
        with fabric.autocast():
            layers = generator(geometry[[target.subject for target in picked]])
        errors = [(t.errors(layer) * weights).sum() for t, layer in zip(picked, layers.float(), strict=True)]
        error = torch.stack(errors).mean()
        adam.zero_grad(set_to_none=True)
        error.backward()
        adam.step()
        if step % schedule.every:
            continue
        score = scorer.score(scorer.layers(generator.paint))
        if watch is not None:
            watch(step, score)
        stalled = 0 if score > best_score + schedule.gain else stalled + 1
        if score > best_score:
            best, best_score = copy.deepcopy(generator), score
        if stalled >= schedule.patience:
            halved, stalled = halved + 1, 0
            adam.param_groups[0]["lr"] /= 2
            if halved > schedule.halvings:
                return Oracle(best, best_score, step, plateau=True)
    return Oracle(best, best_score, schedule.steps, plateau=False)


def _weights(constant_errors: Mapping[str, float], device: torch.device) -> Float[Tensor, " maps"]:
    """The weight of each map, 1 for base_color; bounded, as the constant layer errs in no map that is constant."""
    unit = constant_errors["base_color"]
    errors = {name: max(error, LEAST_ERRORS.get(name, 0.0)) for name, error in constant_errors.items()}
    relative = [1.0 if name == "base_color" else unit / error for name, error in errors.items()]
    return torch.tensor(relative, device=device)


def oracle_of(
    run: Path,
    fabric: Fabric,
    config: RunConfig,
    load: Callable[[Split], LoadedSplit],
    constants: Tensor,
    schedule: OracleConfig,
    budget: Budget | None,
    shown: Display,
) -> Oracle:
    """The run's oracle, trained now if there is none.

    The oracle is adversarial if the run learns a distribution, and otherwise supervised. One that was trained as long
    as the run is trained again once the run was continued.

    Args:
        load: loads a split.
        constants: the constant layers of the training subjects.
        schedule: of a supervised one.
        budget: of an adversarial one; by default the run's own.
    """
    drawing = learns_distribution(config.train.generator, config.dataset)
    stored = _stored(run, fabric.device)
    as_run = _budget_of(run, config.train)
    if stored is not None and stored.adversarial == drawing:
        if budget is not None or stored.run_steps is None or stored.run_steps >= as_run.steps:
            return stored
        log.info("the oracle is trained anew: the run has made %d steps since", as_run.steps - stored.run_steps)
    if drawing:
        oracle = _adversarial(fabric, config, load, budget or as_run, shown)
        oracle = replace(oracle, run_steps=None if budget else as_run.steps)
    else:
        oracle = _supervised(fabric, config, load, constants, schedule, shown)
    generator = config.train.generator if drawing else config.train.generator.without_random_fields
    save_generator(run / ORACLE, oracle.generator, generator, oracle.score)
    save_record(run / ORACLE_NOTES, _Notes(**{name: getattr(oracle, name) for name in _Notes.model_fields}))
    return oracle


def _stored(run: Path, device: torch.device) -> Oracle | None:
    """The oracle of an earlier evaluation."""
    path, notes = run / ORACLE, run / ORACLE_NOTES
    if not path.is_file() or not notes.is_file():
        return None
    reached = load_record(_Notes, notes)
    generator, score = load_generator(path)
    return Oracle(generator.to(device), score, **reached.model_dump())


def _budget_of(run: Path, config: TrainConfig) -> Budget:
    """The steps that the run has made, by its log, and the time that it was allowed."""
    log = read_metrics(run)
    return Budget(round(log[-1]["step"]) if log else config.steps, config.minutes)


def _adversarial(
    fabric: Fabric, config: RunConfig, load: Callable[[Split], LoadedSplit], budget: Budget, shown: Display
) -> Oracle:
    truth = TrueLayers.of(*load("train"), config, fabric.device)
    shown.begin("training the oracle on true layers", budget.steps)
    generator, steps = train_adversarial_oracle(fabric, config.train, truth, budget, shown.advance)
    return Oracle(generator, None, steps, None)


def _supervised(
    fabric: Fabric,
    config: RunConfig,
    load: Callable[[Split], LoadedSplit],
    constants: Tensor,
    schedule: OracleConfig,
    shown: Display,
) -> Oracle:
    """A supervised oracle, whose training stops by the score on the validation split."""
    trained, seen = load("train")
    targets, _ = make_targets(trained, seen, fabric.device, _TARGETS)
    held_out = load("validation") if "validation" in config.dataset.splits else (trained, seen)
    scorer = Scorer.make(*held_out, constants, fabric.device)
    shown.begin("training the supervised oracle")

    def watch(step: int, score: float) -> None:
        shown.advance(schedule.every, f"recovered {score:.3f}")

    return train_oracle(
        fabric, config.train, stack_inputs(trained, fabric.device).geometry, targets, scorer, schedule, watch
    )
