"""Conditions: which a data set has, and the labels of its exemplars."""

from __future__ import annotations

from typing import Any

import torch

from svbrdfgan.config.models import validate
from svbrdfgan.data.conditions import declared_conditions, labels_of_scenes
from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.networks.conditions import Conditions


def of(**written: Any) -> Conditions:
    return declared_conditions(validate(WeatheringDistribution, written, "here"))


def test_only_what_varies_is_a_label() -> None:
    assert of() == Conditions(None, ("road-dirt",))
    assert of().size == 0
    assert of(amount={"uniform": [0.2, 0.8]}, recipe="rust") == Conditions((0.2, 0.8), ("rust",))
    assert of(amount={"uniform": [0.2, 0.8]}, recipe="rust").size == 1
    assert of(recipe={"choice": ["rust", "dust"]}).size == 2
    assert declared_conditions(None) == Conditions()


def test_exemplars_have_their_own(tiny_exemplars: Exemplars) -> None:
    scenes = tiny_exemplars.scenes
    found = labels_of_scenes(Conditions((0.0, 1.0), ("road-dirt", "rust")), scenes)
    assert found is not None
    assert torch.equal(found, torch.tensor([1.0, 1.0, -1.0]).expand(len(scenes), 3))
    assert labels_of_scenes(Conditions(None, ("road-dirt",)), scenes) is None
