"""Conditions: which a data set has, the labels that stand for them, and what a user may ask for."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from svbrdfgan.config.models import validate
from svbrdfgan.data.conditions import Conditions
from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import ConfigError

BOTH = Conditions((0.2, 0.8), ("rust", "dust"))


def of(**written: Any) -> Conditions:
    return Conditions.of(validate(WeatheringDistribution, written, "here"))


def test_only_what_varies_is_a_label() -> None:
    assert of() == Conditions(None, ("road-dirt",))
    assert of().size == 0
    assert of(amount={"uniform": [0.2, 0.8]}, recipe="rust") == Conditions((0.2, 0.8), ("rust",))
    assert of(amount={"uniform": [0.2, 0.8]}, recipe="rust").size == 1
    assert of(recipe={"choice": ["rust", "dust"]}).size == 2
    assert Conditions.of(None) == Conditions()


def test_labels_stand_for_amount_and_recipe() -> None:
    assert BOTH.labels(0.75, "dust") == [0.5, -1.0, 1.0]
    assert BOTH.choose(0.75, "dust") == BOTH.labels(0.75, "dust")
    assert BOTH.choose(recipe="rust") == BOTH.typical() == pytest.approx(BOTH.labels(0.5, "rust"))
    assert Conditions(None, ("rust",)).choose(recipe="rust") == []


def test_exemplars_have_their_own(tiny_exemplars: Exemplars) -> None:
    scenes = tiny_exemplars.scenes
    found = Conditions((0.0, 1.0), ("road-dirt", "rust")).of_scenes(scenes)
    assert found is not None
    assert torch.equal(found, torch.tensor([1.0, 1.0, -1.0]).expand(len(scenes), 3))
    assert Conditions(None, ("road-dirt",)).of_scenes(scenes) is None


@pytest.mark.parametrize(
    ("conditions", "asked", "said"),
    [
        (BOTH, {"amount": 2.0, "recipe": "rust"}, "amount 2 is not allowed; wanted a number from 0 to 1"),
        (BOTH, {"amount": -0.5, "recipe": "rust"}, "amount -0.5 is not allowed"),
        (BOTH, {"recipe": "rusty"}, r"does not know the recipe 'rusty'; did you mean 'rust'\? It knows rust, dust\."),
        (BOTH, {"recipe": "snow"}, r"does not know the recipe 'snow'\. It knows rust, dust\."),
        (BOTH, {}, "knows the recipes rust, dust: name the one that is wanted"),
        (Conditions(), {"recipe": "rust"}, "It knows none"),
        (Conditions(), {"amount": 0.5}, "the model does not know amounts: leave out the amount"),
    ],
)
def test_what_cannot_be_painted_is_refused(conditions: Conditions, asked: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        conditions.choose(**asked)
    assert len(str(caught.value).splitlines()) == 1
