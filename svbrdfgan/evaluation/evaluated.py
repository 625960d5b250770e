"""A run that was evaluated, and pictures of its scenes under each of its layers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.record import Evaluation, Painter
from svbrdfgan.evaluation.relight import PaintedScene
from svbrdfgan.metrics.flip import display as as_displayed
from svbrdfgan.networks.generator import Generator
from svbrdfgan.scene.window import bordered
from svbrdfgan.training.batches import BatchSource
from svbrdfgan.training.run import RunConfig
from svbrdfgan.types import Layer

LayersOf = Callable[[int], dict[Painter, Layer]]
"""The layers of a weathered exemplar, by painter; a generator's layer has the exemplar's own amount and recipe."""


@dataclass(frozen=True, eq=False)
class Evaluated:
    """The score of a run, and what pictures of it need.

    Attributes:
        config: the run's.
        source: the scored split.
        layers: the layers of each subject, of all painters but the truth. A generator with conditions paints the middle
            amount of the first recipe.
        layers_of: the layers of an exemplar; for pictures next to it.
        relit: a few of the scenes that the run was relit in, with their pictures.
        close_ups: small parts of a few vehicles, if the generator varies.
        generator: the run's, on the device of the layers; for draws of it.
    """

    evaluation: Evaluation
    config: RunConfig
    source: BatchSource
    layers: dict[Painter, Float[Tensor, "subjects rows cols channels"]]
    layers_of: LayersOf
    relit: tuple[PaintedScene, ...] = ()
    close_ups: tuple[PaintedScene, ...] = ()
    generator: Generator | None = None

    def learned(self, index: int) -> Layer:
        """The generator's layer of a weathered exemplar, on the CPU."""
        return self.layers_of(index)["generated"].to("cpu")


def by_subject(exemplars: Exemplars, layers: Mapping[Painter, Tensor]) -> LayersOf:
    """The layers of each exemplar's subject, and the exemplar's true one."""

    def layers_of(index: int) -> dict[Painter, Layer]:
        subject, truth = int(exemplars.subject_of[index]), exemplars.layers[index]
        assert truth is not None
        return {name: Layer(painted[subject], truth.maps) for name, painted in layers.items()} | {"truth": truth}

    return layers_of


def pictures(source: BatchSource, index: int, layers: Iterable[Layer]) -> list[Float[Tensor, "height width 3"]]:
    """Display-referred pictures of an exemplar's scene, one under each layer."""
    scenes, shown = source.scenes([index], np.random.default_rng(0)), []
    for layer in layers:
        values = bordered(layer.values) if source.windowed else layer.values
        with torch.no_grad():
            image, coverage = scenes.render(values.unsqueeze(0).to(source.device))
        shown.append(as_displayed(image[0].cpu(), coverage=coverage[0].cpu().float()))
    return shown
