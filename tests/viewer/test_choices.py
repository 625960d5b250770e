"""What can be chosen."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from svbrdfgan.config.models import validate
from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.viewer.choices import OFFERED, _truth


def test_recipes_of_the_laboratory_are_not_offered() -> None:
    assert OFFERED == ("road-dirt", "dust", "rust", "chipped-paint", "grime")


@pytest.mark.parametrize(
    ("declared", "seeds", "amounts", "painted"),
    [
        ({"recipe": "rust", "seed": 5, "amount": 0.3}, False, None, (5, 0.3)),
        ({"recipe": "rust", "seed": {"uniform": [0, 9]}, "amount": 0.3}, True, None, (2, 0.3)),
        ({"recipe": "rust", "seed": 5, "amount": {"uniform": [0.2, 1.0]}}, False, (0.2, 1.0, 0.6), (5, 0.9)),
    ],
)
def test_the_truth_is_what_the_data_set_declares(
    declared: dict[str, Any], seeds: bool, amounts: tuple[float, ...] | None, painted: tuple[int, float]
) -> None:
    weathering = validate(WeatheringDistribution, declared, "weathering")
    dataset = SimpleNamespace(config=SimpleNamespace(weathering=weathering, maps={}), index=SimpleNamespace(model=None))
    (choice,) = _truth(dataset, "van.glb")  # type: ignore[arg-type]
    assert choice.seeds == seeds
    assert choice.amounts == (None if amounts is None else pytest.approx(amounts))
    made = choice.make(2, 0.9).description
    assert (made["recipe"], made["seed"], made["amount"]) == ("rust", *painted)
