"""Finds the folder of a model that a user names: one that is shipped, or that of a run."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.records import load_record
from svbrdfgan.models.card import ModelCard
from svbrdfgan.utils.named_files import expanded

FOLDER = Path(__file__).parent
"""Holds a folder for each shipped model, which is a run's folder with a card and a picture beside its model."""
DEFAULT = "road-dirt"
"""The recipe that is painted if nothing is asked for."""
CONFIG, MODEL = "config.json", "model.safetensors"
"""Files in the folder of every model: its run's configuration, and its generator."""
CARD, PICTURE = "card.json", "picture.jpg"
"""Files in the folder of a shipped model besides."""


def shipped_models() -> Mapping[str, Path]:
    """The folder of each shipped model, by its name."""
    return {card.parent.name: card.parent for card in sorted(FOLDER.glob(f"*/{CARD}"))}


def load_card(folder: Path) -> ModelCard:
    """The card of a shipped model.

    Raises:
        AssetError: the card is missing or not JSON.
        ConfigError: the card is not one.
    """
    return load_record(ModelCard, folder / CARD)


def model_of(recipe: str) -> str:
    """The name of the shipped model that learned a recipe: of the one of the same name, if there are several.

    Raises:
        ConfigError: no shipped model did.
    """
    learned = {name: load_card(folder).recipes for name, folder in shipped_models().items()}
    fitting = [name for name, recipes in learned.items() if recipe in recipes]
    if not fitting:
        known = sorted({each for recipes in learned.values() for each in recipes})
        told = f"Shipped models know {', '.join(known)}" if known else "This version ships no model"
        raise ConfigError(
            f"no shipped model learned the recipe {recipe!r}{did_you_mean(recipe, known) or '.'} {told}; --model names "
            "another one, and `svbrdfgan weather --recipe` paints recipes themselves."
        )
    return recipe if recipe in fitting else fitting[0]


def model_folder(model: str | os.PathLike[str], base: Path = Path()) -> Path:
    """The folder of the shipped model of that name, or else the path itself, relative to `base`.

    A `Path`, and a text with a separator such as "./rust", is always that of a folder.
    """
    shipped = shipped_models().get(model) if isinstance(model, str) else None
    return shipped or base / expanded(model)


def require_model(folder: Path) -> None:
    """Refuses a path that is not the folder of a model.

    Raises:
        AssetError: the message names the shipped models, one of which may have been meant.
    """
    if not (folder / CONFIG).is_file():
        shipped = shipped_models()
        raise AssetError(
            f"{folder} is not a run: it has no {CONFIG}; and no model of that name is shipped"
            f"{did_you_mean(folder.name, shipped) or '.'} Shipped are {', '.join(shipped) or 'none'}."
        )
