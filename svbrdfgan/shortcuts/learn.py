"""A probe: a discriminator that learns which of two clean pictures is the exemplar's, judged on pairs kept back."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from svbrdfgan.errors import ConfigError
from svbrdfgan.losses import LOSSES
from svbrdfgan.shortcuts.stills import Stills
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.state import make_discriminator
from svbrdfgan.training.step import show

_STEPS, _EVERY, _PATIENCE = 200, 10, 5
_BATCH, _RATE = 16, 3e-4
_SURE = 0.01
_BACKGROUNDS = 4
_LEARN, _CHOOSE, _JUDGE = range(3)
_DEALT = (_LEARN, _JUDGE, _LEARN, _JUDGE, _CHOOSE)

Margins = Float[Tensor, " pairs"]
"""For each pair, by how much the exemplar's picture looks more real to the probe, in logits."""


@dataclass(frozen=True, eq=False)
class Roles:
    """Which pairs the probe learns from, which say when it has learned enough, and which it is judged on."""

    learn: Sequence[int]
    choose: Sequence[int]
    judge: Sequence[int]

    @classmethod
    def deal(cls, subject_of: Sequence[int], seed: int) -> Roles:
        """Two, one and two fifths, by whole subjects; by single pairs where there are fewer than five subjects.

        Raises:
            ConfigError: there are fewer than five pairs.
        """
        least = len(_DEALT)
        if len(subject_of) < least:
            raise ConfigError(f"the data set has {len(subject_of)} exemplars to train on; a probe needs {least}.")
        units = subject_of if len(set(subject_of)) >= least else range(len(subject_of))
        _, unit_of = np.unique(units, return_inverse=True)
        place = np.random.default_rng([seed, 0]).permutation(unit_of.max() + 1)[unit_of] % least
        role = np.array(_DEALT)[place]
        return cls(*(np.flatnonzero(role == wanted).tolist() for wanted in (_LEARN, _CHOOSE, _JUDGE)))


def train_probe(
    config: TrainConfig, real: Stills, fake: Stills, roles: Roles, seconds: float | None = None
) -> Float[Tensor, " judged"]:
    """The margins of the pairs that are judged, by a probe of the configuration's own architecture.

    Its game is one of pairs (Bradley and Terry 1952): it is told two pictures and learns which one is the exemplar's.
    Few scenes are soon learned by heart; so it stops when pairs that it does not learn from say that it gets no better,
    and is judged as it was at its best.

    Args:
        seconds: stops earlier, after so much time; what is learned then depends on the machine.
    """
    device, began = real.image.device, time.monotonic()
    probe = _fresh(config, device)
    adam = torch.optim.AdamW(probe.parameters(), _RATE, (config.optimizer.beta1, config.optimizer.beta2))
    rng = np.random.default_rng([config.seed, 1])
    best, least, waited = copy.deepcopy(probe), math.inf, 0
    for step in range(1, _STEPS + 1):
        pairs = rng.choice(roles.learn, min(_BATCH, len(roles.learn)), replace=False).tolist()
        game = show(real.shot(pairs), fake.shot(pairs), rng)
        loss = LOSSES["relativistic"].discriminator(probe(game.real), probe(game.fake))
        adam.zero_grad(set_to_none=True)
        loss.backward()
        adam.step()
        if step % _EVERY:
            continue
        doubt = float(nn.functional.softplus(-_margins(probe, real, fake, roles.choose)).mean())
        waited = 0 if doubt < least else waited + 1
        if doubt < least:
            best, least = copy.deepcopy(probe), doubt
        late = seconds is not None and time.monotonic() - began > seconds
        if least < _SURE or waited >= _PATIENCE or late:
            break
    return _margins(best, real, fake, roles.judge).cpu()


def _fresh(config: TrainConfig, device: torch.device) -> nn.Module:
    """With larger weights than training begins with (He et al. 2015), which saves the probe its first hundred steps."""
    probe, rng = make_discriminator(config.discriminator), torch.Generator().manual_seed(config.seed)
    for module in probe.modules():
        if isinstance(module, nn.Conv2d):
            nn.init.kaiming_normal_(module.weight, 0.2, generator=rng)
            if module.bias is not None:
                nn.init.zeros_(module.bias)
    return probe.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it


@torch.no_grad()
def _margins(probe: nn.Module, real: Stills, fake: Stills, pairs: Sequence[int]) -> Margins:
    """Means over a few backgrounds."""
    rng, found = np.random.default_rng(0), []
    for first in range(0, len(pairs), _BATCH):
        some = pairs[first : first + _BATCH]
        games = [show(real.shot(some), fake.shot(some), rng) for _ in range(_BACKGROUNDS)]
        margins = [(probe(game.real) - probe(game.fake)).mean(dim=(1, 2)) for game in games]
        found.append(torch.stack(margins).mean(dim=0))
    return torch.cat(found)
