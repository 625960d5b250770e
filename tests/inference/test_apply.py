"""A trained generator on a mesh of one's own: which draw it paints, and what it refuses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from svbrdfgan.errors import ConfigError
from svbrdfgan.inference.apply import paint
from svbrdfgan.networks import Conditions, Generator
from svbrdfgan.procedural import build_vehicle, sample_vehicle
from svbrdfgan.training.run import Model, load_model
from svbrdfgan.types import Mesh


@pytest.fixture(scope="module")
def model(varied_run: Path) -> Model:
    return load_model(varied_run)


@pytest.fixture(scope="module")
def mesh() -> Mesh:
    return build_vehicle(sample_vehicle("van", 5))


def test_the_same_words_paint_the_same_layer_and_others_another(mesh: Mesh, model: Model) -> None:
    def layer(**asked: Any) -> Tensor:
        return paint(mesh, model, **{"seed": 7, "amount": 0.4, "recipe": "rust"} | asked)[1]

    assert layer().shape == (32, 32, 4)
    assert torch.equal(layer(), layer())
    for other in ({"seed": 8}, {"amount": 0.9}, {"recipe": "dust"}):
        assert not torch.equal(layer(**other), layer())


def test_by_default_it_is_seed_0_and_the_middle_amount(mesh: Mesh, model: Model) -> None:
    _, wanted = paint(mesh, model, seed=0, amount=0.6, recipe="dust")
    torch.testing.assert_close(paint(mesh, model, recipe="dust")[1], wanted, atol=1e-6, rtol=1e-6)


def test_amounts_that_it_never_saw_are_told(mesh: Mesh, model: Model, caplog: pytest.LogCaptureFixture) -> None:
    paint(mesh, model, amount=0.1, recipe="rust")
    assert "amount 0.1 is beyond those that the model was trained on: 0.2 to 1" in caplog.text


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ({"recipe": "rust", "seed": -1}, "seed -1 is not allowed; wanted a whole number from 0"),
        ({"recipe": "rust", "seed": 2**63}, "is not allowed; wanted a whole number from 0"),
        ({"recipe": "rust", "amount": 2.0}, "amount 2 is not allowed"),
        ({"recipe": "mud"}, "does not know the recipe 'mud'"),
    ],
)
def test_what_it_cannot_paint_is_told(asked: dict[str, Any], said: str, mesh: Mesh, model: Model) -> None:
    with pytest.raises(ConfigError, match=said):
        paint(mesh, model, **asked)


def test_a_model_without_chance_has_no_seeds(mesh: Mesh, model: Model) -> None:
    train = model.config.train
    plain = train.model_copy(update={"generator": train.generator.without_chance})
    config = model.config.model_copy(update={"train": plain})
    still = replace(model, generator=Generator(width=4, blocks=1), config=config)
    assert config.conditions == Conditions()
    for asked, said in (({"seed": 0}, "has no chance"), ({"amount": 0.5}, "does not know amounts")):
        with pytest.raises(ConfigError, match=said):
            paint(mesh, still, **asked)
    assert paint(mesh, still)[1].shape == (32, 32, 4)
