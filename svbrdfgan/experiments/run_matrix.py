"""From an experiment's file to the runs it takes: every row crossed with its recipes and seeds, resolved."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import cached_property
from pathlib import Path
from typing import get_args

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import StrictModel
from svbrdfgan.config.yaml_files import apply_overrides
from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, Split, dataset_config
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.definition import (
    Experiment,
    Profile,
    ProfileName,
    Recipe,
    Row,
    experiment_names,
    load_experiment,
    load_profile,
)
from svbrdfgan.training.config import TrainConfig, resolved, train_config

_ELSEWHERE = "dataset"
"""Stands for the data set's folder, which is chosen when the run is placed."""


class DatasetSpec(StrictModel):
    """All that a data set depends on."""

    dataset: DatasetConfig


class OracleSpec(StrictModel):
    """All that an oracle depends on: the data, and the run of a single step whose oracle it is."""

    dataset: DatasetConfig
    train: TrainConfig
    steps: int


class RunSpec(StrictModel):
    """All that the outcome of a run depends on. Paths in it are relative to the assets."""

    train: TrainConfig
    oracle: OracleSpec

    @property
    def dataset(self) -> DatasetConfig:
        return self.oracle.dataset

    @property
    def files(self) -> list[str]:
        """The patterns of the files that it needs."""
        config, scenes = self.dataset, self.train.scenes
        sources = [split.meshes for split in config.splits.values()]
        lights = [config.environments, *(split.environments for split in config.splits.values()), scenes.environment]
        found = [pattern for source in sources for pattern in source.files]
        return found + [p for light in lights if isinstance(light, EnvironmentSource) for p in light.files]


@dataclass(frozen=True)
class Cell:
    """One run of an experiment, which is known by its name."""

    experiment: str
    row: str
    recipe: Recipe
    seed: int
    spec: RunSpec

    @property
    def title(self) -> str:
        return f"{self.row}, {self.recipe}, seed {self.seed}"

    def matches(self, pattern: str) -> bool:
        """Whether it is one of those that EXPERIMENT/ROW/RECIPE/SEED means, or as much of that as is said."""
        mine, wanted = (self.experiment, self.row, self.recipe, str(self.seed)), pattern.split("/")
        return len(wanted) <= len(mine) and all(map(fnmatchcase, mine, wanted))


@dataclass(frozen=True)
class Design:
    """An experiment in a profile.

    Attributes:
        overrides: KEY=VALUE, with keys that begin with `dataset.` or `train.`; rows change what these leave.
    """

    name: str
    experiment: Experiment
    profile_name: ProfileName
    profile: Profile
    overrides: tuple[str, ...] = ()

    @classmethod
    def load(cls, name: str, profile: ProfileName, overrides: Sequence[str] = ()) -> Design:
        """The design of a shipped experiment, or of one's own by its file.

        Raises:
            ConfigError: there is none, or its file is wrong.
        """
        for override in overrides:
            if not override.startswith(("dataset.", "train.")):
                raise ConfigError(f"{override!r} changes nothing here; keys begin with 'dataset.' or 'train.'.")
        stem = name if name in experiment_names() else Path(name).stem
        return cls(stem, load_experiment(name), profile, load_profile(profile), tuple(overrides))

    def cells(self, seeds: Collection[int] = ()) -> list[Cell]:
        """The runs, in the order of the table.

        Args:
            seeds: instead of those that the rows name.

        Raises:
            ConfigError: the configuration of a row is wrong.
        """
        return [
            self.cell(name, recipe, seed)
            for name, row in self.experiment.rows.items()
            for recipe, declared in self.recipes(row).items()
            for seed in seeds or declared[: self.profile.seeds]
        ]

    def cell(self, name: str, recipe: Recipe, seed: int) -> Cell:
        """One run.

        Raises:
            ConfigError: one line for each fault of its configuration.
        """
        data = apply_overrides(self._base, self.changes(name))
        source = f"{self.name}, row {name}"
        dataset = dataset_config(data["dataset"], source)
        lacking = [split for split in get_args(Split) if split not in dataset.splits]
        if lacking:
            raise ConfigError(f"{source}: dataset.splits lacks {' and '.join(lacking)}, on which scores are taken.")
        told = {"recipe": recipe, "seed": seed, "dataset": _ELSEWHERE}
        train = resolved(train_config({**data["train"], **told}, source), dataset.spp)
        return Cell(self.name, name, recipe, seed, RunSpec(train=train, oracle=self._oracle(dataset, train)))

    def changes(self, name: str) -> list[str]:
        """What a row changes, as KEY=VALUE."""
        return self.experiment.rows[name].overrides_in(self.profile_name)

    @property
    def common(self) -> list[str]:
        """What all rows change in the profile, likewise."""
        return [*self.experiment.overrides_in(self.profile_name), *self.overrides]

    def recipes(self, row: Row) -> dict[Recipe, tuple[int, ...]]:
        """What a row is trained by, and with which seeds."""
        return self.experiment.recipes if row.recipes is None else row.recipes

    @cached_property
    def _base(self) -> dict[str, dict[str, object]]:
        base = {"dataset": self.profile.dataset, "train": self.profile.train}
        return apply_overrides(base, self.common)

    def _oracle(self, dataset: DatasetConfig, train: TrainConfig) -> OracleSpec:
        """The same wherever data and generator are, whatever else an experiment or a row changes."""
        base = apply_overrides({"train": self.profile.train}, (o for o in self.overrides if o.startswith("train.")))
        told = {"seed": 0, "dataset": _ELSEWHERE, "steps": 1, "minutes": None}
        same = train_config({**base["train"], **told}, self.name).model_copy(update={"generator": train.generator})
        return OracleSpec(dataset=dataset, train=same, steps=self.profile.oracle_steps)


def choose(cells: Sequence[Cell], patterns: Sequence[str]) -> list[Cell]:
    """Those that match, in the order of the patterns; all if there are none.

    Raises:
        ConfigError: a pattern matches none.
    """
    if not patterns:
        return list(cells)
    chosen: list[Cell] = []
    for pattern in patterns:
        matching = [cell for cell in cells if cell.matches(pattern)]
        if not matching:
            known = list(dict.fromkeys(f"{cell.experiment}/{cell.row}" for cell in cells))
            hint = did_you_mean(pattern, known) or f"; there are {', '.join(known)}."
            raise ConfigError(f"no run matches {pattern!r}{hint}")
        chosen += [cell for cell in matching if cell not in chosen]
    return chosen
