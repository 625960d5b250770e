"""The oracle of a distribution: the same generator, trained adversarially on true layers instead of pictures.

Regression to the true layers cannot be the ceiling of a generator with random fields: where the truth varies, it
paints the mean. The oracle of this module has the run's networks, loss, penalties and optimizers, and as many true
layers as the run has exemplars. The discriminator sees textures. So what the run lacks, compared with the oracle, is
what pictures hide.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.conditions import labels_of_scenes
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError, TrainingError
from svbrdfgan.metrics.recovered import SeenTexels, shown_texels
from svbrdfgan.metrics.texture_pyramid import premultiplied, premultiplied_values
from svbrdfgan.networks.generator import GEOMETRY_CHANNELS, Generator
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.discriminator_batch import DiscriminatorBatch, Pictures, tone_curve
from svbrdfgan.training.run import RunConfig
from svbrdfgan.training.state import State
from svbrdfgan.training.step import Diagnostics, adversarial_step, batch_indices, draw_seeds
from svbrdfgan.training.subject_inputs import stack_inputs
from svbrdfgan.types import Layer
from svbrdfgan.utils.copy_async import copy_async

Watch = Callable[[int], None]
"""Called with the number of steps that are done since the last call."""

_CHECK_EVERY = 50
"""Steps between two looks at the losses, which wait for the device."""


@dataclass(frozen=True)
class Budget:
    """The length of the oracle's training: as many steps as the run it is compared with, and no more time.

    No score stops the training: to compare many draws costs as much as many steps.
    """

    steps: int
    minutes: float | None = None


@dataclass(frozen=True, eq=False)
class TrueLayers:
    """The true layers of a split's exemplars, and the texels on which pictures show them.

    Attributes:
        geometry: the generator's input for each subject; and as its G-buffer the discriminator's.
        shown: learnable texels that some picture of the subject shows. The discriminator sees no other: a run learns
            nothing of them.
        layers: one for each exemplar, in main memory and half precision, as exemplars' pictures.
        subject_of: index of each exemplar's subject.
        labels: of each exemplar's layer; None if networks have no conditions.
        gbuffer: whether the discriminator is shown the geometry.
    """

    geometry: Float[Tensor, "subjects inputs rows cols"]
    shown: Bool[Tensor, "subjects rows cols"]
    layers: Layer
    subject_of: Int[Tensor, " exemplars"]
    labels: Float[Tensor, "exemplars labels"] | None
    gbuffer: bool

    @classmethod
    def of(cls, exemplars: Exemplars, seen: SeenTexels, config: RunConfig, device: torch.device) -> TrueLayers:
        """The true layers of a training split.

        Args:
            seen: says which texels a picture shows.

        Raises:
            AssetError: no picture shows a learnable texel, or a layer's file is damaged.
        """
        shown = [
            shown_texels(exemplars, seen, number) & subject.learnable_texels & (subject.buffer.area > 0)
            for number, subject in enumerate(exemplars.subjects)
        ]
        views = [v for number, texels in enumerate(shown) if texels.any() for v in exemplars.views_of(number)]
        if not views:
            raise AssetError("the oracle has nothing to learn from: no picture shows a learnable part.")
        layers = torch.stack([layer.values.half() for view in views if (layer := exemplars.layers[view]) is not None])
        labels = labels_of_scenes(config.conditions, [exemplars.scenes[view] for view in views])
        return cls(
            stack_inputs(exemplars, device).geometry,
            torch.stack(shown).to(device),
            Layer(layers, tuple(config.dataset.maps)),
            exemplars.subject_of[views],
            None if labels is None else labels.to(device),
            config.train.discriminator.gbuffer,
        )

    def __len__(self) -> int:
        return len(self.subject_of)

    @property
    def judged(self) -> int:
        """Channels of a layer as the discriminator sees it."""
        return 1 + sum(premultiplied_values(name) for name in ("base_color", *self.layers.maps))

    def batch(
        self, fabric: Fabric, generator: Generator, indices: Sequence[int], rng: np.random.Generator
    ) -> DiscriminatorBatch:
        """The true layers of some exemplars, and as many of the generator's with the same geometry and labels."""
        device, chosen = self.geometry.device, torch.as_tensor(list(indices))
        subjects, picked = (copy_async(values, device) for values in (self.subject_of[chosen], chosen))
        labels = None if self.labels is None else self.labels[picked]
        seeds = draw_seeds(rng, len(indices), device) if generator.random_fields else None
        with fabric.autocast():
            made = generator(self.geometry[subjects], seeds, labels)
        true = copy_async(self.layers.values[chosen], device).float()
        return DiscriminatorBatch(*(self._seen(layers, subjects, labels) for layers in (true, made)))

    def _seen(
        self, layers: Float[Tensor, "batch rows cols channels"], subjects: Int[Tensor, " batch"], labels: Tensor | None
    ) -> Pictures:
        """Layers as the discriminator sees them, in [-1, 1], with geometry and labels; zero where nothing is shown.

        The discriminator sees alpha, and the maps times alpha, as `resemblance` does: sets that agree in these agree
        over every paint, so no paint need be drawn. Colours have the tone curve of pictures.
        """
        alpha, color, further = premultiplied(Layer(layers, self.layers.maps)).split([1, 3, self.judged - 4], dim=1)
        channels = [2 * alpha - 1, tone_curve(color), further]
        if self.gbuffer:
            channels.append(self.geometry[subjects, :GEOMETRY_CHANNELS])
        if labels is not None:
            channels.append(labels[:, :, None, None].expand(-1, -1, *alpha.shape[2:]))
        return torch.cat(channels, dim=1) * self.shown[subjects].unsqueeze(1)


def train_adversarial_oracle(
    fabric: Fabric, config: TrainConfig, truth: TrueLayers, budget: Budget, watch: Watch | None = None
) -> tuple[Generator, int]:
    """The averaged generator, and the steps that it was trained for.

    Random numbers depend on the configuration's seed and the step alone; but `budget.minutes` may end training at any
    step.

    Raises:
        TrainingError: a loss or weight is not finite.
    """
    state = _fresh_state(config, truth)
    critics, began = config.loss.critic_steps, time.monotonic()

    def make(_: int, indices: Sequence[int], rng: np.random.Generator) -> DiscriminatorBatch:
        return truth.batch(fabric, state.generator, indices, rng)

    while state.step < budget.steps and (budget.minutes is None or time.monotonic() - began < 60 * budget.minutes):
        numbers = range(state.step * critics, (state.step + 1) * critics)
        batches = [batch_indices(config.seed, len(truth), config.batch_size, number) for number in numbers]
        found = adversarial_step(fabric, config, state, batches, make)
        if state.step % _CHECK_EVERY == 0:
            _require_finite(found, state.step)
        if watch is not None:
            watch(1)
    _require_finite({"weights": torch.stack([each.sum() for each in state.averaged.parameters()]).sum()}, state.step)
    return state.averaged, state.step


def _fresh_state(config: TrainConfig, truth: TrueLayers) -> State:
    """The initial state of a run which judges layers, and refines no other's: what only pictures have is not shown."""
    of_pictures = dict.fromkeys(("light_buffer", "clean_picture", "pixel_size"), False)
    discriminator = config.discriminator.model_copy(update=of_pictures)
    generator = config.generator.model_copy(update={"refined": None})
    labels = 0 if truth.labels is None else truth.labels.shape[1]
    return State.fresh(
        config.model_copy(update={"discriminator": discriminator, "generator": generator}),
        truth.geometry.device,
        truth.layers.maps,
        labels=labels,
        judged=truth.judged,
    )


def _require_finite(diagnostics: Diagnostics, step: int) -> None:
    if not all(bool(value.isfinite()) for value in diagnostics.values()):
        raise TrainingError(
            f"the oracle stopped at step {step}: a loss or weight is not finite. Evaluate without the oracle, or train "
            "a run with a lower optimizer.generator_rate."
        )
