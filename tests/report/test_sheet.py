"""Sheets of what a model paints on a mesh: rows of what it varies with, and a sentence where it does not vary."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from svbrdfgan.errors import ConfigError
from svbrdfgan.networks.generator import Generator
from svbrdfgan.report.sheet import COLUMNS, sheet_rows
from svbrdfgan.training.run import Model, RunConfig, load_model


@pytest.fixture(scope="module")
def model(varied_run: Path) -> Model:
    return load_model(varied_run)


def test_it_has_rows_of_seeds_amounts_and_recipes(model: Model) -> None:
    seeds, amounts, recipes = sheet_rows(model, seed=3, amount=0.4, recipe="rust")
    assert [row.title for row in (seeds, amounts, recipes)] == [
        "Seeds, rust, amount 0.40", "Amounts, rust, seed 3", "Recipes, amount 0.40, seed 3",
    ]  # fmt: skip
    assert [label for label, _ in seeds.cells] == [f"seed {number}" for number in range(3, 3 + COLUMNS)]
    assert [label for label, _ in recipes.cells] == ["rust", "dust"]
    assert len({tuple(draw.labels) for _, draw in amounts.cells}) == COLUMNS
    assert {draw.seed for _, draw in amounts.cells} == {3}


def test_what_the_model_does_not_know_is_told(model: Model) -> None:
    with pytest.raises(ConfigError, match="does not know the recipe 'snow'"):
        sheet_rows(model, recipe="snow")


def test_a_model_of_one_layer_has_nothing_to_compare(model: Model) -> None:
    plain = replace(model, generator=Generator(width=4, blocks=0), config=without_conditions(model.config))
    with pytest.raises(ConfigError, match="paints one layer on a mesh, so a sheet has nothing to compare"):
        sheet_rows(plain)


def without_conditions(config: RunConfig) -> RunConfig:
    generator = config.train.generator.without_random_fields
    return config.model_copy(update={"train": config.train.model_copy(update={"generator": generator})})
