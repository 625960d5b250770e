"""What a viewer offers to paint with: recipes, shipped models, and what a run learned beside its truth."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from svbrdfgan.config.distributions import Fixed, limits, mean, values_of
from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.data.index import Dataset
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.weatherings import RecipeWeathering, Weathering
from svbrdfgan.models.shipped import shipped_models
from svbrdfgan.training.run import Model, load_model
from svbrdfgan.types import FURTHER_MAPS
from svbrdfgan.weathering.layer import recipe_from_options
from svbrdfgan.weathering.recipes import RECIPES

OFFERED = tuple(name for name in RECIPES if not name.startswith("smooth-"))
"""The recipes for artists; the others are a laboratory's."""


@dataclass(frozen=True, eq=False)
class Choice:
    """One way to weather, with what a user may vary of it.

    Attributes:
        label: for people; `group` is the heading that it stands under.
        make: the weathering of a seed, and of an amount if there are amounts.
        seeds: whether layers depend on a seed.
        amounts: least, greatest and usual amount; None if there is one alone.
        command: the words of the command that writes the same, up to seed and amount; empty if there is none.
    """

    label: str
    group: str
    make: Callable[[int, float], Weathering]
    seeds: bool
    amounts: tuple[float, float, float] | None
    command: str = ""

    def description(self) -> dict[str, Any]:
        """What a page says of it."""
        keys = ("label", "group", "seeds", "amounts", "command")
        return {key: getattr(self, key) for key in keys}


def recipe_choice(name: str, path: str) -> Choice:
    """A procedural recipe, on the file of that name."""
    usual = float(RECIPES[name]().amount)

    def make(seed: int, amount: float) -> Weathering:
        return RecipeWeathering(recipe_from_options(name, {"amount": amount, "seed": seed}))

    command = f"svbrdfgan weather {shlex.quote(path)} --recipe {name}"
    return Choice(_title(name), "Recipes", make, True, (0.0, 1.0, usual), command)


def model_choices(model: Model, name: str, label: str, group: str, path: str) -> Iterator[Choice]:
    """A trained model, which paints on a GPU if there is one; one choice for each recipe that it is told apart.

    Args:
        name: of a shipped model, or the folder of a run.
    """
    model.on("auto")
    recipes = model.config.conditions.recipes
    for recipe in recipes or (None,):
        title = f"{label}: {_title(recipe)}" if recipe and len(recipes) > 1 else label
        yield _model_choice(model, name, title, group, path, recipe)


def _model_choice(model: Model, name: str, title: str, group: str, path: str, recipe: str | None) -> Choice:
    known, stochastic = model.config.conditions.amount, bool(model.generator.random_fields)

    def make(seed: int, amount: float) -> Weathering:
        asked = (seed if stochastic else None), (None if known is None else amount)
        return LearnedWeathering.of(model, name=Path(name).name, seed=asked[0], amount=asked[1], recipe=recipe)

    told = f" --recipe {recipe}" if recipe else ""
    command = f"svbrdfgan texture {shlex.quote(path)} --model {shlex.quote(name)}{told}"
    return Choice(title, group, make, stochastic, None if known is None else (0.0, 1.0, sum(known) / 2.0), command)


def offered(path: str) -> list[Choice]:
    """All shipped models and recipes, for a file."""
    choices: list[Choice] = []
    for name in shipped_models():
        choices += model_choices(load_model(name), name, _title(name), "Learned (shipped models)", path)
    return choices + [recipe_choice(name, path) for name in OFFERED]


def of_run(run: Path, dataset: Dataset, path: str) -> list[Choice]:
    """What a run learned, and what its exemplars show if that is known."""
    learned = list(model_choices(load_model(run), str(run), "Learned", "This run", path))
    return learned + list(_truth(dataset, path))


def _truth(dataset: Dataset, path: str) -> Iterator[Choice]:
    declared, painter = dataset.config.weathering, dataset.index.model
    maps = tuple(name for name in FURTHER_MAPS if name in dataset.config.maps)
    if not isinstance(declared, WeatheringDistribution):
        return
    if painter is not None:
        folder = (dataset.folder / painter.asset.path).parent
        yield from model_choices(load_model(folder), str(folder), "Truth", "This run", path)
        return
    names = values_of(declared.recipe)
    for name in names:
        title = "Truth" if len(names) == 1 else f"Truth: {_title(name)}"
        yield _true_recipe(name, title, declared, maps)


def _true_recipe(name: str, title: str, declared: WeatheringDistribution, maps: Collection[str]) -> Choice:
    """A recipe as a data set declares it: where that fixes the seed or the amount, there is no other."""
    seed, amount = declared.seed, declared.amount

    def make(chosen_seed: int, chosen_amount: float) -> Weathering:
        drawn = {
            "seed": seed.fixed if isinstance(seed, Fixed) else chosen_seed,
            "amount": amount.fixed if isinstance(amount, Fixed) else chosen_amount,
        }
        return RecipeWeathering(recipe_from_options(name, {**declared.options, **drawn}), maps)

    amounts = None if isinstance(amount, Fixed) else (*limits(amount, 0.0, 1.0), min(max(mean(amount), 0.0), 1.0))
    return Choice(title, "This run", make, not isinstance(seed, Fixed), amounts)


def _title(name: str) -> str:
    return name.replace("-", " ").capitalize()
