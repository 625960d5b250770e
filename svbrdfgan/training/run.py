"""A run's folder: its configuration and its models, written and read."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from svbrdfgan.config.distributions import mean
from svbrdfgan.config.models import StrictModel, differences
from svbrdfgan.data.conditions import conditions_of
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.data.index import Dataset
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.models.shipped import CONFIG as CONFIG
from svbrdfgan.models.shipped import MODEL as MODEL
from svbrdfgan.models.shipped import model_folder, require_model
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.saved import load_generator
from svbrdfgan.networks.tiles import Windows
from svbrdfgan.scene.window import WHOLE
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.resolve import ResolvedRun
from svbrdfgan.utils.devices import Device, torch_device

LOG = "log.jsonl"
ORACLE = "oracle.safetensors"
ORACLE_NOTES = "oracle.json"
_LENGTH = ("steps", "minutes", "score_every", "save_every", "device", "devices", "dataset", "init", "refines")
_STABILITY = {"optimizer": {"generator_rate", "discriminator_rate"}, "loss": {"r1"}}
FREE: dict[str, Any] = {
    "train": dict.fromkeys(_LENGTH, True) | _STABILITY,
    "versions": True,
    "dataset_folder": True,
}
"""Keys that may differ when a run is resumed."""


class RunConfig(StrictModel):
    """The contents of a run's `config.json`: the whole resolved configuration of a run."""

    train: TrainConfig
    dataset: DatasetConfig
    dataset_folder: str
    versions: dict[str, str]

    @classmethod
    def of(cls, run: ResolvedRun) -> RunConfig:
        """The record of a run that is about to start, with the versions of what computes it."""
        folder = str(run.dataset.folder)
        return cls(train=run.config, dataset=run.dataset.config, dataset_folder=folder, versions=versions())

    @property
    def maps(self) -> dict[str, float]:
        """Maps that layers paint besides base_color, and the mean of their values under the layer in the data set."""
        return {name: min(max(mean(value), 0.0), 1.0) for name, value in self.dataset.maps.items()}

    @property
    def conditions(self) -> Conditions:
        """The facts of each layer that the generator is told."""
        return conditions_of(self.train.generator, self.dataset)

    def moved(self, dataset: Dataset) -> RunConfig:
        """The same run with its data set in another folder.

        Raises:
            ConfigError: it is another data set.
        """
        if dataset.config != self.dataset:
            raise ConfigError(
                f"{dataset.folder} is of another configuration than the data set that the run learned from."
            )
        return self.model_copy(update={"dataset_folder": str(dataset.folder.resolve())})

    def scored_on(self, dataset: Dataset) -> RunConfig:
        """The same run as if it had learned from another data set, so that it can be scored there.

        Raises:
            ConfigError: layers of that data set have other maps or no windows, or the generator is told what does not
                vary there.
        """
        if tuple(dataset.config.maps) != tuple(self.dataset.maps):
            here, there = (", ".join(("base_color", *maps)) for maps in (self.dataset.maps, dataset.config.maps))
            raise ConfigError(f"the run paints {here}, and the layers of {dataset.folder} have {there}.")
        if self.train.generator.refined is not None and not dataset.config.windowed:
            raise ConfigError(
                f"the run refines layers in windows, and not all close-ups of {dataset.folder} have them."
            )
        generator = self.train.generator.model_copy(update={"conditions": self.conditions.size > 0})
        train = self.train.model_copy(update={"generator": generator})
        found = self.model_copy(
            update={"train": train, "dataset": dataset.config, "dataset_folder": str(dataset.folder.resolve())}
        )
        if self.conditions.size and not self.conditions.alike(found.conditions):
            raise ConfigError(
                f"the run is told each layer's amount and recipe where they varied in its own data set; those of "
                f"{dataset.folder} must vary likewise."
            )
        return found

    def save(self, run: Path) -> None:
        save_record(run / CONFIG, self)

    @classmethod
    def load(cls, run: Path) -> RunConfig:
        """Reads a run's configuration.

        Raises:
            AssetError: the folder is no run.
        """
        if not (run / CONFIG).is_file():
            raise AssetError(f"{run} is not a run: it has no {CONFIG}; make one with `svbrdfgan train`.")
        return load_record(cls, run / CONFIG)

    def require_same(self, other: RunConfig) -> None:
        """Checks that a configuration continues this run.

        Raises:
            ConfigError: something else differs than length, logging, machine, folders, and what a user may change
                after a loss that was not finite (the rates and loss.r1).
        """
        mine, its = (config.model_dump(exclude=FREE) for config in (self, other))
        if changed := differences(mine, its):
            raise ConfigError(f"the run was started with other settings ({'; '.join(changed)}); start a new one.")


@dataclass(frozen=True, eq=False)
class Model:
    """A trained generator and the configuration of its run, which names its embedding and texture size."""

    generator: Generator
    config: RunConfig
    score: float | None

    def on(self, device: Device) -> Model:
        """The same model, whose generator paints on that device from now on.

        Raises:
            ConfigError: the device is `cuda`, and torch finds no GPU.
        """
        self.generator.to(torch_device(device))
        return self

    @property
    def geometry_texels(self) -> int:
        """Texels along a side of the geometry that it reads of whole meshes: if it learned from windows, of a map as
        those were placed in."""
        texture = self.config.dataset.texture
        return texture if self.config.dataset.window is None or texture % WHOLE else WHOLE

    @property
    def windows(self) -> Windows | None:
        """What it was trained on, if not on whole maps."""
        size = self.config.dataset.window
        return None if size is None else Windows(size, self.config.dataset.texture // self.geometry_texels)


def load_model(model: str | os.PathLike[str]) -> Model:
    """A shipped model, or the best generator of a run, by its validation score.

    Args:
        model: the name of a shipped model, such as "rust", or the folder of a run. A `Path`, and a text with a
            separator such as "./rust", is always that of a folder.

    Raises:
        AssetError: no model is shipped under that name and the folder is no run, or it has no model yet.
    """
    folder = model_folder(model)
    require_model(folder)
    config = RunConfig.load(folder)
    generator, score = load_generator(folder / MODEL)
    return Model(generator, config, score)


def versions() -> dict[str, str]:
    """Versions of everything that results may depend on."""
    import platform

    import numpy

    from svbrdfgan import __version__

    return {
        "svbrdfgan": __version__,
        "torch": torch.__version__,
        "numpy": numpy.__version__,
        "python": platform.python_version(),
    }
