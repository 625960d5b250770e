"""The conditions of a data set: what is known of its exemplars' layers."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.distributions import limits, values_of
from svbrdfgan.data.config import DatasetConfig, WeatheringDistribution
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.saved import GeneratorConfig
from svbrdfgan.scene.description import Scene, SceneWeathering


def declared_conditions(weathering: WeatheringDistribution | None) -> Conditions:
    """The conditions that a data set declares; none where the weathering is not known, as of imported pictures."""
    if weathering is None:
        return Conditions()
    low, high = limits(weathering.amount, 0.0, 1.0)
    return Conditions((low, high) if low < high else None, values_of(weathering.recipe))


def conditions_of(generator: GeneratorConfig, dataset: DatasetConfig) -> Conditions:
    """The conditions that networks are told of each layer; none if the generator is not conditional."""
    known = declared_conditions(dataset.weathering)
    return known if generator.conditional else known.untold()


def labels_of_scenes(conditions: Conditions, scenes: Sequence[Scene]) -> Float[Tensor, "exemplars labels"] | None:
    """The labels of exemplars; None if there are no conditions."""
    if not conditions.size:
        return None
    found = [scene.weathering for scene in scenes]
    known = [weathering for weathering in found if isinstance(weathering, SceneWeathering)]
    assert len(known) == len(found), "a data set with a weathering records it in each scene"
    return torch.tensor([conditions.labels(weathering.amount, weathering.recipe) for weathering in known])
