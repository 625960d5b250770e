"""One step of the game: the discriminator's updates, then the generator's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor, nn

from svbrdfgan.networks.losses import LOSSES, gradient_penalty, gradient_square
from svbrdfgan.training.batches import Feed
from svbrdfgan.training.cached_rendering import Layers, Stage, sight_of
from svbrdfgan.training.config import LossConfig, TrainConfig
from svbrdfgan.training.demodulation import carried
from svbrdfgan.training.picture import present
from svbrdfgan.training.state import State
from svbrdfgan.utils.copy_async import copy_async

Diagnostics = dict[str, Tensor]
Pictures = Float[Tensor, "batch channels height width"]
Shot = tuple[Tensor, Tensor, Tensor | None]
"""Image, coverage and G-buffer of a batch; no G-buffer where the discriminator does not look at one."""


@dataclass(frozen=True, eq=False)
class Round:
    """One batch of exemplars, beside fakes in scenes of their own, before common backgrounds."""

    real: Pictures
    fake: Pictures


def training_step(
    fabric: Fabric, config: TrainConfig, state: State, feed: Feed, batches: Sequence[Sequence[int]]
) -> Diagnostics:
    """Updates the discriminator once for each batch of exemplars and then the generator once.

    Chance depends on the seed and the step alone, so that a resumed run goes on as if it had never stopped.
    """
    report: Diagnostics = {}
    for critic, indices in enumerate(batches):
        last = critic == len(batches) - 1
        rng = chance(fabric, config, state.step, critic)
        with torch.set_grad_enabled(last):
            game = _play(fabric, config, state, feed, indices, rng)
        report |= _update_discriminator(fabric, config.loss, state, game, rng)
    return report | _update_generator(fabric, config, state, game)


def chance(fabric: Fabric, config: TrainConfig, step: int, critic: int) -> np.random.Generator:
    """What one batch of a step draws from: first its scenes."""
    return np.random.default_rng([config.seed, step, critic, fabric.global_rank])


def _play(
    fabric: Fabric, config: TrainConfig, state: State, feed: Feed, indices: Sequence[int], rng: np.random.Generator
) -> Round:
    with fabric.autocast():
        layers = state.generator(feed.geometry(indices))
    return show(*sides(feed, indices, feed.stage(indices, rng), layers), rng)


def sides(feed: Feed, indices: Sequence[int], stage: Stage, layers: Layers) -> tuple[Shot, Shot]:
    """These exemplars, and fakes of these layers, as the discriminator is to see them.

    Where it sees reflectance, fakes are seen from the exemplars' cameras, whatever their own. The exemplars go to the
    fakes' cameras and back, so that both are blurred alike, and both show only what all of this leaves.
    """
    real, (made, coverage) = feed.real(indices), stage.render(layers)
    if not feed.demodulated:
        return real, (made, coverage, None if feed.gbuffers is None else stage.gbuffer)
    here, there = feed.sight(indices), sight_of(stage)
    shown, clear = carried(here.reflectance(real[0]), here.clear, here, there, here)
    feigned, also = carried(there.reflectance(made), there.clear, there, here, here)
    both = clear & also
    pair = (torch.where(both.unsqueeze(-1), image, 0.0) for image in (shown, feigned))
    first, second = ((image, both.float(), real[2]) for image in pair)
    return first, second


def show(real: Shot, fake: Shot, rng: np.random.Generator) -> Round:
    """Both sides as the discriminator sees them: each pair before a background of its own, drawn anew."""
    device = real[0].device
    background = copy_async(torch.from_numpy(rng.random((len(real[0]), 3), dtype=np.float32)), device)
    return Round(*(present(image, coverage, background, gbuffer) for image, coverage, gbuffer in (real, fake)))


def _update_discriminator(
    fabric: Fabric, loss: LossConfig, state: State, game: Round, rng: np.random.Generator
) -> Diagnostics:
    critic, real, fake = state.discriminator, game.real.detach(), game.fake.detach()
    critic.requires_grad_(True)
    with fabric.autocast():
        real_logits, fake_logits = critic(torch.cat((real, fake))).chunk(2)
    total = LOSSES[loss.name].discriminator(real_logits, fake_logits)
    report = {"d_loss": total.detach(), "d_real": real_logits.detach().mean(), "d_fake": fake_logits.detach().mean()}
    if state.step % loss.penalty_every == 0:
        penalty = _penalty(loss, critic, real, fake, rng)
        total = total + penalty * loss.penalty_every
        report["d_penalty"] = penalty.detach()
    state.discriminator_adam.zero_grad(set_to_none=True)
    total.backward()
    state.discriminator_gradients.finish()
    state.discriminator_adam.step()
    return report | {"d_accuracy": (real_logits > fake_logits).float().mean()}


def _penalty(loss: LossConfig, critic: nn.Module, real: Tensor, fake: Tensor, rng: np.random.Generator) -> Tensor:
    total = real.new_zeros(())
    if loss.r1:
        total = total + 0.5 * loss.r1 * gradient_square(critic, real)
    if loss.r2:
        total = total + 0.5 * loss.r2 * gradient_square(critic, fake)
    if loss.gradient_penalty:
        mix = copy_async(torch.from_numpy(rng.random(len(real), dtype=np.float32)), real.device)
        total = total + loss.gradient_penalty * gradient_penalty(critic, real, fake, mix)
    return total


def _update_generator(fabric: Fabric, config: TrainConfig, state: State, game: Round) -> Diagnostics:
    state.discriminator.requires_grad_(False)

    def judged(pictures: Pictures) -> Tensor:
        with fabric.autocast():
            logits: Tensor = state.discriminator(pictures)
        return logits

    total = LOSSES[config.loss.name].generator(lambda: judged(game.real), judged(game.fake))
    state.generator_adam.zero_grad(set_to_none=True)
    total.backward()
    state.generator_gradients.finish()
    state.generator_adam.step()
    state.step += 1
    state.average(config.batch_size, config.optimizer.ema_images)
    return {"g_loss": total.detach()}
