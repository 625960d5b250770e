"""How a run's generator resembles the distribution of the true layers: draws of both, on the scored vehicles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.metrics.draw_statistics import Draws, ScoredSurface
from svbrdfgan.metrics.recovered import Scorer
from svbrdfgan.metrics.resemblance import Resemblance, Resembler
from svbrdfgan.networks import Draw
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.training.batches import Progress
from svbrdfgan.training.run import Model

DRAWS = 16
"""Layers of each vehicle, in each of three sets: true ones, other true ones, and the generator's."""


def resemblance_of(
    model: Model,
    fabric: Fabric,
    exemplars: Exemplars,
    scorer: Scorer,
    constants: Tensor,
    progress: Progress | None = None,
    count: int = DRAWS,
) -> Resemblance:
    """The score of the model's draws on the split's vehicles.

    All sets have the amounts and recipes of the vehicle's own exemplars, in turn, so that sets differ by their seeds
    alone. Painting the true ones takes most of the time: some tenths of a second for each layer of 256 x 256.

    Args:
        scorer: of the split; says which texels are scored.
        constants: constant layers to compare with.
        progress: called with the number of vehicles that are done since the last call.
        count: draws of each vehicle in each set.

    Raises:
        AssetError: the true draws do not vary, or the textures are too small to compare.
    """
    declared = model.config.dataset.weathering
    assert declared is not None, "a split is scored only if its layers are known"
    weights = {target.subject: target.weight for target in scorer.targets}
    surfaces, sets = [], []
    for number, weight in weights.items():
        subject, views = exemplars.subjects[number], exemplars.views_of(number)
        scenes = [exemplars.scenes[view] for view in views if exemplars.weathered(view)]
        chosen = [scenes[n % len(scenes)] for n in range(count)]
        surfaces.append(ScoredSurface(weight, subject.buffer.part.to(weight.device)))
        true = _true_draws(exemplars, number, chosen * 2, declared)
        painted = _generated(model, fabric, scorer.geometry[number], chosen)
        sets.append((*true.to(weight.device).chunk(2), painted))
        if progress is not None:
            progress(1)
    truth, again, generated = (list(each) for each in zip(*sets, strict=True))
    return Resembler.make(surfaces, truth, again, constants).score(generated)


def _true_draws(exemplars: Exemplars, number: int, scenes: Sequence[Scene], declared: WeatheringDistribution) -> Draws:
    """True layers of these scenes of one vehicle, each painted with a new seed."""
    rng, layers = np.random.default_rng([1, number]), []
    for scene in scenes:
        drawn = _weathering(scene).model_copy(update={"seed": declared.seed.sample(rng)})
        layers.append(exemplars.loader.paint(scene, drawn))
    return torch.stack(layers)


def _generated(model: Model, fabric: Fabric, geometry: Tensor, scenes: Sequence[Scene]) -> Draws:
    """What the generator paints with the amounts and recipes of these scenes, and seeds from 0 on."""
    generator, layers = model.generator.to(fabric.device), []
    for seed, scene in enumerate(scenes):
        asked = _weathering(scene)
        draw = Draw(generator, seed, model.config.conditions.labels(asked.amount, asked.recipe))
        with torch.no_grad(), fabric.autocast():
            layers.append(draw(geometry.unsqueeze(0))[0].float())
    return torch.stack(layers)


def _weathering(scene: Scene) -> SceneWeathering:
    assert isinstance(scene.weathering, SceneWeathering)
    return scene.weathering
