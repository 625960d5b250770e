"""A run that was evaluated, and pictures of its scenes under each of its layers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.evaluation.relight import RelitScene
from svbrdfgan.metrics.flip import display as as_displayed
from svbrdfgan.networks.generator import Generator
from svbrdfgan.training.batches import BatchSource
from svbrdfgan.training.run import RunConfig

LayersOf = Callable[[int], dict[str, Float[Tensor, "rows cols channels"]]]
"""The layers of an exemplar, by what painted them; a generator's layer has the exemplar's own amount and recipe."""


@dataclass(frozen=True, eq=False)
class Evaluated:
    """The score of a run, and what pictures of it need.

    Attributes:
        config: the run's.
        source: the scored split.
        layers: the layers of each subject, by what painted them: "generated", "oracle" or "constant". A generator with
            conditions paints the middle amount of the first recipe.
        layers_of: the layers of an exemplar; for pictures next to it.
        relit: a few of the scenes that the run was relit in, with their pictures.
        close_ups: small parts of a few vehicles, if the generator varies.
        generator: the run's, on the device of the layers; for draws of it.
    """

    evaluation: Evaluation
    config: RunConfig
    source: BatchSource
    layers: dict[str, Float[Tensor, "subjects rows cols channels"]]
    layers_of: LayersOf
    relit: tuple[RelitScene, ...] = ()
    close_ups: tuple[RelitScene, ...] = ()
    generator: Generator | None = None


def by_subject(exemplars: Exemplars, layers: dict[str, Tensor]) -> LayersOf:
    """The layers of each exemplar's subject."""
    return lambda index: {name: painted[int(exemplars.subject_of[index])] for name, painted in layers.items()}


def pictures(
    source: BatchSource, index: int, layers: dict[str, Float[Tensor, "rows cols channels"]]
) -> dict[str, Float[Tensor, "height width 3"]]:
    """Display-referred pictures of an exemplar's scene, one under each layer and one under G0's own ("truth")."""
    scenes = source.scenes([index], np.random.default_rng(0))
    shown = {}
    for name, layer in {**layers, "truth": source.exemplars.layers[index]}.items():
        if layer is not None:
            with torch.no_grad():
                image, coverage = scenes.render(layer.unsqueeze(0).to(source.buffers.device))
            shown[name] = as_displayed(image[0].cpu(), coverage=coverage[0].cpu().float())
    return shown
