"""Probes: discriminators that learn which of two clean pictures is the exemplar's, judged on pairs kept back."""

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
from svbrdfgan.evaluation.leakage.stills import Stills
from svbrdfgan.networks.losses import LOSSES
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.state import make_discriminator
from svbrdfgan.training.step import Round, show

_STEPS, _EVERY, _PATIENCE = 200, 10, 5
_BATCH, _RATE = 16, 3e-4
_SURE = 0.01
_BACKGROUNDS = 4
_PROBES = 3
_LEARN, _CHOOSE, _JUDGE = range(3)
_DEALT = (_LEARN, _JUDGE, _LEARN, _JUDGE, _CHOOSE)

Margins = Float[Tensor, " pairs"]
"""For each pair, by how much the exemplar's picture looks more real than the fake."""


@dataclass(frozen=True, eq=False)
class Roles:
    """Which pairs probes learn from, which say when they have learned enough, and which they are judged on."""

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


@dataclass(frozen=True, eq=False)
class Trial:
    """Two sides that are to be told apart."""

    config: TrainConfig
    real: Stills
    fake: Stills
    roles: Roles

    def judge(self, seconds: float | None = None) -> Margins:
        """The margins of the pairs kept back, by three probes of the configuration's own architecture together.

        Each weighs as much as it is sure of the pairs that told it when to stop.

        Args:
            seconds: each stops earlier, after a third of it; what is learned then depends on the machine.
        """
        total = torch.zeros(len(self.roles.judge))
        for number in range(_PROBES):
            probe = self._train(number, None if seconds is None else seconds / _PROBES)
            scale = self._margins(probe, self.roles.choose).abs().mean().clamp(min=1e-12)
            total += (self._margins(probe, self.roles.judge) / scale).cpu()
        return total

    def _train(self, number: int, seconds: float | None) -> nn.Module:
        """A probe that learned which of two pictures is the exemplar's (Bradley and Terry 1952), as it was at its best.

        Few scenes are soon learned by heart; so it stops when pairs that it does not learn from say that it gets no
        better.
        """
        began, rng = time.monotonic(), np.random.default_rng([self.config.seed, 1, number])
        probe = self._fresh(number)
        optimizer = self.config.optimizer
        adam = torch.optim.AdamW(probe.parameters(), _RATE, (optimizer.beta1, optimizer.beta2))
        best, least, waited = copy.deepcopy(probe), math.inf, 0
        for step in range(1, _STEPS + 1):
            pairs = rng.choice(self.roles.learn, min(_BATCH, len(self.roles.learn)), replace=False).tolist()
            game = self._game(pairs, rng)
            loss = LOSSES["relativistic"].discriminator(probe(game.real), probe(game.fake))
            adam.zero_grad(set_to_none=True)
            loss.backward()
            adam.step()
            if step % _EVERY:
                continue
            doubt = float(nn.functional.softplus(-self._margins(probe, self.roles.choose)).mean())
            waited = 0 if doubt < least else waited + 1
            if doubt < least:
                best, least = copy.deepcopy(probe), doubt
            late = seconds is not None and time.monotonic() - began > seconds
            if least < _SURE or waited >= _PATIENCE or late:
                break
        return best

    def _fresh(self, number: int) -> nn.Module:
        """With larger weights than training begins with (He et al. 2015), which saves the first hundred steps."""
        rng = torch.Generator().manual_seed(self.config.seed * _PROBES + number)
        probe = make_discriminator(self.config.discriminator)
        for module in probe.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, 0.2, generator=rng)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        device = self.real.image.device
        return probe.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it

    def _game(self, pairs: Sequence[int], rng: np.random.Generator) -> Round:
        return show(self.real.shot(pairs), self.fake.shot(pairs), rng)

    @torch.no_grad()
    def _margins(self, probe: nn.Module, pairs: Sequence[int]) -> Margins:
        """Means over patches and a few backgrounds."""
        rng, found = np.random.default_rng(0), []
        for first in range(0, len(pairs), _BATCH):
            games = [self._game(pairs[first : first + _BATCH], rng) for _ in range(_BACKGROUNDS)]
            margins = [(probe(game.real) - probe(game.fake)).mean(dim=(1, 2)) for game in games]
            found.append(torch.stack(margins).mean(dim=0))
        return torch.cat(found)
