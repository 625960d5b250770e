"""Conditions: the labels that stand for them, and what a user may ask for."""

from __future__ import annotations

from typing import Any

import pytest

from svbrdfgan.errors import ConfigError
from svbrdfgan.networks.conditions import Conditions

BOTH = Conditions((0.2, 0.8), ("rust", "dust"))


def test_labels_stand_for_amount_and_recipe() -> None:
    assert BOTH.labels(0.75, "dust") == [0.5, -1.0, 1.0]
    assert BOTH.choose(0.75, "dust") == BOTH.labels(0.75, "dust")
    assert BOTH.choose(recipe="rust") == BOTH.typical() == pytest.approx(BOTH.labels(0.5, "rust"))
    assert Conditions(None, ("rust",)).choose(recipe="rust") == []


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
