"""Makes the folder of a shipped model from that of a run."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from svbrdfgan.config.models import validate
from svbrdfgan.data.conditions import declared_conditions
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.records import save_record
from svbrdfgan.models.card import ModelCard
from svbrdfgan.models.shipped import CARD, MODEL, PICTURE
from svbrdfgan.networks.saved import load_generator, save_generator
from svbrdfgan.training.run import RunConfig

LARGEST = 10_000_000
"""Bytes that a shipped model may have, its picture included."""


def ship(run: Path, folder: Path, card: ModelCard, picture: Path) -> None:
    """Writes a run's best generator into a folder of its own, to be shipped: `load_model` reads it from there.

    Weights are in half precision, and the configuration names no path of this machine.

    Args:
        folder: is made; it has the card's name.
        picture: .jpg; what the model paints.

    Raises:
        AssetError: the folder of the run has no model, or a file cannot be written.
        ConfigError: the card is of another folder or of other recipes, the picture is no JPEG, or all is too large.
    """
    if folder.name != card.name:
        raise ConfigError(f"the folder {folder} has another name than the model, {card.name}.")
    if picture.suffix.lower() not in (".jpg", ".jpeg"):
        raise ConfigError(f"{picture} is no picture that is shipped; wanted a .jpg file.")
    config, (generator, score) = RunConfig.load(run), load_generator(run / MODEL)
    learned = declared_conditions(config.dataset.weathering).recipes
    if set(learned) != set(card.recipes):
        raise ConfigError(
            f"the card names the recipes {', '.join(card.recipes)}; the run learned {', '.join(learned)}."
        )
    shown = picture.read_bytes()
    size = len(shown) + 2 * sum(weights.numel() for weights in generator.state_dict().values())
    if size > LARGEST:
        raise ConfigError(f"the model takes {size / 1e6:.1f} MB with its picture; wanted {LARGEST / 1e6:.0f} at most.")
    save_generator(folder / MODEL, generator, config.train.generator, score, half=True)
    _anywhere(config, str(run)).save(folder)
    save_record(folder / CARD, card)
    with atomic_path(folder / PICTURE) as temporary:
        temporary.write_bytes(shown)


def _anywhere(config: RunConfig, source: str) -> RunConfig:
    """The configuration without what it says of one machine's folders."""
    data = config.model_dump(mode="json")
    data["dataset_folder"] = data["train"]["dataset"] = ""
    return validate(RunConfig, _without_folders(data), source)


def _without_folders(value: Any) -> Any:
    """The same data, whose texts that are paths outside of the current folder have become names."""
    if isinstance(value, dict):
        return {key: _without_folders(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_without_folders(each) for each in value]
    if not isinstance(value, str):
        return value
    outside = PurePosixPath(value).is_absolute() or PureWindowsPath(value).is_absolute()
    return PureWindowsPath(value).name if outside or value.startswith(("~", "..")) else value
