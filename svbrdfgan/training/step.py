"""A training step: the discriminator's updates, then the generator's."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float, Int
from lightning_fabric import Fabric
from torch import Tensor, nn

from svbrdfgan.data.reflectance_errors import MAX_REFLECTANCE, with_errors
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.networks.losses import LOSSES, gradient_penalty, gradient_square
from svbrdfgan.networks.random_fields import MOST_SEEDS
from svbrdfgan.scene.window import bordered
from svbrdfgan.training.batches import BatchSource
from svbrdfgan.training.config import LossConfig, TrainConfig
from svbrdfgan.training.demodulation import reproject
from svbrdfgan.training.discriminator_batch import DiscriminatorBatch, ImageBatch, Pictures, composite_pair
from svbrdfgan.training.scene_batch import Coverage, Images, Layers, SceneBatch
from svbrdfgan.training.state import State
from svbrdfgan.utils.copy_async import copy_async

Diagnostics = dict[str, Tensor]
"""Detached scalars to report, by name."""
MakeBatch = Callable[[int, Sequence[int], np.random.Generator], DiscriminatorBatch]
"""Makes what the discriminator compares, given the critic step, exemplar indices, and a random generator."""


def training_step(
    fabric: Fabric, config: TrainConfig, state: State, source: BatchSource, batches: Sequence[Sequence[int]]
) -> Diagnostics:
    """`adversarial_step` on pictures: exemplars and renderings of the generator's layers."""
    augmented = state.augmented if config.discriminator.augment else None

    def make(critic_step: int, indices: Sequence[int], rng: np.random.Generator) -> DiscriminatorBatch:
        visit = (state.step * len(batches) + critic_step) * config.batch_size // len(source)
        pair = _pair(fabric, state, source, indices, rng, visit)
        return composite_pair(*pair, rng, augmented, config.discriminator.octaves)

    diagnostics = adversarial_step(fabric, config, state, batches, make)
    if augmented is None:
        return diagnostics
    state.adapt(torch.as_tensor(fabric.all_reduce(diagnostics["d_accuracy"])), config.batch_size)
    return diagnostics | {"d_augmented": augmented.clone()}


def adversarial_step(
    fabric: Fabric, config: TrainConfig, state: State, batches: Sequence[Sequence[int]], make_batch: MakeBatch
) -> Diagnostics:
    """Updates the discriminator once for each batch of exemplar indices, and then the generator once.

    Random numbers depend on the seed and the step alone, so that a resumed run continues as if it had never stopped.

    Args:
        make_batch: runs the generator; of the last batch with gradients.
    """
    diagnostics: Diagnostics = {}
    for critic_step, indices in enumerate(batches):
        last = critic_step == len(batches) - 1
        rng = step_rng(fabric, config, state.step, critic_step)
        with torch.set_grad_enabled(last):  # only the last batch updates the generator
            batch = make_batch(critic_step, indices, rng)
        diagnostics |= _update_discriminator(fabric, config.loss, state, batch, rng)
    return diagnostics | _update_generator(fabric, config, state, batch)


def step_rng(fabric: Fabric, config: TrainConfig, step: int, critic_step: int) -> np.random.Generator:
    """The random generator of one batch of a step. The batch's scenes are drawn from it first."""
    return np.random.default_rng([config.seed, step, critic_step, fabric.global_rank])


def batch_indices(seed: int, count: int, batch_size: int, number: int) -> list[int]:
    """The exemplar indices of a batch: every epoch goes through all exemplars in a random order of its own."""
    positions = np.arange(number * batch_size, (number + 1) * batch_size)
    epochs = {int(r): np.random.default_rng([seed, int(r)]).permutation(count) for r in np.unique(positions // count)}
    return [int(epochs[int(p // count)][p % count]) for p in positions]


def make_pair(
    source: BatchSource,
    indices: Sequence[int],
    scenes: SceneBatch,
    layers: Layers,
    errors: Float[Tensor, "batch height width 8"] | None = None,
) -> tuple[ImageBatch, ImageBatch]:
    """Pairs the exemplars with fakes of these layers, as the discriminator compares them.

    Where it sees reflectance, fakes are reprojected into the exemplars' cameras. Exemplars are reprojected into the
    fakes' cameras and back, so that both sides are blurred alike, and both keep only the pixels that this leaves.

    Args:
        errors: those that the exemplars' import may have made (`svbrdfgan.data.reflectance_errors`); fakes in the
            exemplars' cameras get them, too.
    """
    real = source.pictures(indices)
    image, coverage = scenes.render(layers)
    if not source.demodulated:
        return real, _with_buffers(image, coverage, real, scenes)
    own, others = source.own_scenes.first_scenes(indices).demodulator, scenes.demodulator
    if own is None or others is None:
        raise TypeError(f"{type(scenes).__name__} has no light to divide by; `TrainConfig` refuses this earlier")
    real_image, real_clear = reproject(own.reflectance(real.image), own.clear, own, others, own)
    fake = others.reflectance(image)
    if errors is not None:
        fake = with_errors(fake, errors).clamp(0.0, MAX_REFLECTANCE)
    fake_image, fake_clear = reproject(fake, others.clear, others, own, own)
    clear = real_clear & fake_clear
    both = [torch.where(clear.unsqueeze(-1), shown, 0.0) for shown in (real_image, fake_image)]
    sides = [replace(real, image=image, coverage=clear.float()) for image in both]
    return sides[0], sides[1]


def _with_buffers(image: Images, coverage: Coverage, real: ImageBatch, scenes: SceneBatch) -> ImageBatch:
    """Fakes and the buffers that exemplars have: those of their own scenes, or else the exemplars'."""

    def shown(name: str) -> Tensor | None:  # by name, since a scene may render a buffer when it is first asked for it
        exemplars: Tensor | None = getattr(real, name)
        own: Tensor | None = None if exemplars is None else getattr(scenes, name)
        return exemplars if exemplars is None or own is None else own.to(exemplars.device)

    buffers = (shown("gbuffer"), shown("light_buffer"), shown("clean"))
    return ImageBatch(image, coverage, *buffers, real.labels, real.pixel_size)


def _pair(
    fabric: Fabric, state: State, source: BatchSource, indices: Sequence[int], rng: np.random.Generator, visit: int
) -> tuple[ImageBatch, ImageBatch]:
    with fabric.autocast():
        layers = _painted(state, source.inputs(indices), source.labels(indices), indices, rng)
    if source.windowed:
        layers = bordered(layers)
    scenes = source.scenes(indices, rng, visit)
    return make_pair(source, indices, scenes, layers, source.drawn_errors(indices, rng))


def _painted(
    state: State,
    inputs: Inputs,
    labels: Float[Tensor, "batch labels"] | None,
    indices: Sequence[int],
    rng: np.random.Generator,
) -> Float[Tensor, "batch rows cols channels"]:
    if state.refined is None:
        seeds = draw_seeds(rng, len(indices), inputs.device) if state.generator.random_fields else None
        return state.generator.paint(inputs, seeds, labels)
    drawn = state.refined.draw(indices, rng.spawn(1)[0])
    beneath = state.refined.windows(inputs, drawn, labels)
    return state.generator(inputs.geometry, copy_async(torch.tensor(drawn), inputs.device), labels, beneath=beneath)


def draw_seeds(rng: np.random.Generator, count: int, device: torch.device) -> Int[Tensor, " batch"]:
    """A seed for each layer of a batch, from a stream of its own: the scenes and backgrounds drawn from `rng` stay."""
    return copy_async(torch.from_numpy(rng.spawn(1)[0].integers(MOST_SEEDS, size=count)), device)


def _update_discriminator(
    fabric: Fabric, loss: LossConfig, state: State, batch: DiscriminatorBatch, rng: np.random.Generator
) -> Diagnostics:
    critic, real, fake = state.discriminator, batch.real.detach(), batch.fake.detach()
    critic.requires_grad_(True)
    with fabric.autocast():
        real_logits, fake_logits = critic(torch.cat((real, fake))).chunk(2)
    total = LOSSES[loss.name].discriminator(real_logits, fake_logits)
    report = {"d_loss": total.detach(), "d_real": real_logits.detach().mean(), "d_fake": fake_logits.detach().mean()}
    if state.step % loss.penalty_every == 0:
        penalty = _penalty(loss, critic, real, fake, rng)
        total = total + penalty * loss.penalty_every  # lazy regularisation (StyleGAN2): fewer steps, larger weight
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


def _update_generator(fabric: Fabric, config: TrainConfig, state: State, batch: DiscriminatorBatch) -> Diagnostics:
    state.discriminator.requires_grad_(False)

    def logits_of(pictures: Pictures) -> Tensor:
        with fabric.autocast():
            logits: Tensor = state.discriminator(pictures)
        return logits

    total = LOSSES[config.loss.name].generator(lambda: logits_of(batch.real), logits_of(batch.fake))
    state.generator_adam.zero_grad(set_to_none=True)
    total.backward()
    state.generator_gradients.finish()
    state.generator_adam.step()
    state.step += 1
    state.average(config.batch_size, config.optimizer.ema_images)
    return {"g_loss": total.detach()}
