"""The oracle: the same network on the same data, supervised with the true layers; a ceiling for the GAN."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.metrics.map_errors import LEAST_ERRORS
from svbrdfgan.metrics.recovered import Scorer, Target
from svbrdfgan.networks import Generator, initialise
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.state import make_generator

Watch = Callable[[int, float], None]
"""Called with the step and the validation score at every scoring."""


@dataclass(frozen=True)
class OracleConfig:
    """How the oracle is trained: to its best, independent of the run's batch size and learning rates.

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
    """A trained oracle.

    Attributes:
        plateau: whether its score stopped rising before the last step.
    """

    generator: Generator
    score: float
    steps: int
    plateau: bool


def train_oracle(
    fabric: Fabric,
    config: TrainConfig,
    geometry: Float[Tensor, "subjects 6 rows cols"],
    targets: list[Target],
    scorer: Scorer,
    schedule: OracleConfig,
    watch: Watch | None = None,
) -> Oracle:
    """Minimises E of every map on the training targets until the score of `scorer` stops rising.

    The error of a map counts relative to its constant layer's, as in `recovered`, in units of base_color's.
    """
    generator = make_generator(config.generator, targets[0].truth.shape[-1])
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
        score = scorer.score(scorer.layers(generator))
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
    """One for base_color. A map whose truth is constant counts as if its constant layer erred by the least error."""
    unit = constant_errors["base_color"]
    errors = {name: max(error, LEAST_ERRORS.get(name, 0.0)) for name, error in constant_errors.items()}
    relative = [1.0 if name == "base_color" else unit / error for name, error in errors.items()]
    return torch.tensor(relative, device=device)
