"""Classifiers that learn which of two clean pictures is the exemplar's, judged on held-out pairs."""

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
from svbrdfgan.networks.losses import LOSSES
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.discriminator_batch import DiscriminatorBatch, ImageBatch, composite_pair
from svbrdfgan.training.state import make_discriminator

_STEPS = 200  # of a classifier, at most
_EVERY = 10  # steps between two looks at the pairs that choose when it stops
_PATIENCE = 5  # looks without an improvement after which it stops
_BATCH = 16  # pairs in a step
_RATE = 3e-4  # AdamW's learning rate
_SURE = 0.01  # loss on the choosing pairs below which it stops: nothing is left to learn
_BACKGROUNDS = 4  # random ones over which margins are averaged
_PROBES = 3  # classifiers whose margins are added
_LEARN, _CHOOSE, _JUDGE = range(3)  # the roles of `Roles`
_DEALT = (_LEARN, _JUDGE, _LEARN, _JUDGE, _CHOOSE)

Margins = Float[Tensor, " pairs"]
"""The logit of the exemplar's picture less that of the fake, for each pair; summed over classifiers when judged."""


@dataclass(frozen=True, eq=False)
class Roles:
    """Pairs that classifiers learn from, pairs that choose when they stop, and pairs that they are judged on."""

    learn: Sequence[int]
    choose: Sequence[int]
    judge: Sequence[int]

    @classmethod
    def deal(cls, meshes: Sequence[str], seed: int) -> Roles:
        """Two fifths, one fifth and two fifths of all pairs, at random.

        Pairs of one mesh share a role, unless there are fewer than five meshes.

        Args:
            meshes: what names that of each pair.

        Raises:
            ConfigError: there are fewer than five pairs.
        """
        least = len(_DEALT)
        if len(meshes) < least:
            raise ConfigError(f"the data set has {len(meshes)} exemplars to train on; a probe needs {least}.")
        names = list(meshes) if len(set(meshes)) >= least else list(map(str, range(len(meshes))))
        _, unit_of = np.unique(names, return_inverse=True)
        place = np.random.default_rng([seed, 0]).permutation(unit_of.max() + 1)[unit_of] % least
        role = np.array(_DEALT)[place]
        return cls(*(np.flatnonzero(role == wanted).tolist() for wanted in (_LEARN, _CHOOSE, _JUDGE)))


@dataclass(frozen=True, eq=False)
class Trial:
    """Both sides' pictures, which classifiers try to tell apart."""

    config: TrainConfig
    real: ImageBatch
    fake: ImageBatch
    roles: Roles

    def judge(self, seconds: float | None = None) -> Margins:
        """The margins of the held-out pairs: the sum over three classifiers of the discriminator's own architecture.

        Each classifier's margins are divided by their mean size on the pairs that chose when it stops.

        Args:
            seconds: each classifier stops after a third of it at the latest. The result then depends on the machine.
        """
        total = torch.zeros(len(self.roles.judge))
        for number in range(_PROBES):
            network = self._train(number, None if seconds is None else seconds / _PROBES)
            scale = self._margins(network, self.roles.choose).abs().mean().clamp(min=1e-12)
            total += (self._margins(network, self.roles.judge) / scale).cpu()
        return total

    def _train(self, number: int, seconds: float | None) -> nn.Module:
        """A classifier that learned which of two pictures is the exemplar's (Bradley and Terry 1952).

        A classifier soon memorises few scenes. So it stops when it no longer improves on the pairs of `choose`, and its
        best state on them is returned.
        """
        began, rng = time.monotonic(), np.random.default_rng([self.config.seed, 1, number])
        network = self._fresh(number)
        optimizer = self.config.optimizer
        adam = torch.optim.AdamW(network.parameters(), _RATE, (optimizer.beta1, optimizer.beta2))
        best, least, stalled = copy.deepcopy(network), math.inf, 0
        for step in range(1, _STEPS + 1):
            pairs = rng.choice(self.roles.learn, min(_BATCH, len(self.roles.learn)), replace=False).tolist()
            batch = self._batch(pairs, rng)
            loss = LOSSES["relativistic"].discriminator(network(batch.real), network(batch.fake))
            adam.zero_grad(set_to_none=True)
            loss.backward()
            adam.step()
            if step % _EVERY:
                continue
            doubt = float(nn.functional.softplus(-self._margins(network, self.roles.choose)).mean())
            stalled = 0 if doubt < least else stalled + 1
            if doubt < least:
                best, least = copy.deepcopy(network), doubt
            late = seconds is not None and time.monotonic() - began > seconds
            if least < _SURE or stalled >= _PATIENCE or late:
                break
        return best

    def _fresh(self, number: int) -> nn.Module:
        """A network with larger weights than training starts with (He et al. 2015), which saves a hundred steps."""
        rng = torch.Generator().manual_seed(self.config.seed * _PROBES + number)
        network = make_discriminator(self.config.discriminator.model_copy(update={"pixel_size": False}))
        for module in network.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, 0.2, generator=rng)
                if module.bias is not None:
                    nn.init.zeros_(module.bias)
        device = self.real.image.device
        return network.to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]  # torch's stubs lack it

    def _batch(self, pairs: Sequence[int], rng: np.random.Generator) -> DiscriminatorBatch:
        return composite_pair(
            self.real.pick(pairs), self.fake.pick(pairs), rng, octaves=self.config.discriminator.octaves
        )

    @torch.no_grad()
    def _margins(self, network: nn.Module, pairs: Sequence[int]) -> Margins:
        """Margins of these pairs, each the mean over patches and a few backgrounds."""
        rng, found = np.random.default_rng(0), []
        for first in range(0, len(pairs), _BATCH):
            batches = [self._batch(pairs[first : first + _BATCH], rng) for _ in range(_BACKGROUNDS)]
            margins = [(network(batch.real) - network(batch.fake)).mean(dim=(1, 2)) for batch in batches]
            found.append(torch.stack(margins).mean(dim=0))
        return torch.cat(found)
