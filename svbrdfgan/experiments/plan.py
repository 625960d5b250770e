"""What an experiment runs, before any configuration is resolved: its rows, with the recipes and seeds of each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Self

from svbrdfgan.config.yaml_files import apply_overrides
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.definition import (
    Experiment,
    ExperimentProfile,
    ExperimentRow,
    ProfileName,
    Recipe,
    experiment_names,
    load_experiment,
    load_profile,
)


@dataclass(frozen=True)
class Plan:
    """An experiment in a profile.

    Attributes:
        overrides: KEY=VALUE, with keys that begin with `dataset.` or `train.`. The changes of rows override them.
    """

    name: str
    experiment: Experiment
    profile_name: ProfileName
    profile: ExperimentProfile
    overrides: tuple[str, ...] = ()

    @classmethod
    def load(cls, name: str, profile: ProfileName, overrides: Sequence[str] = ()) -> Self:
        """The plan of a shipped experiment by its name, or of a user's by the path of its YAML file.

        Raises:
            ConfigError: there is no such experiment, its file is wrong, or an override has another key.
        """
        for override in overrides:
            if not override.startswith(("dataset.", "train.")):
                raise ConfigError(f"{override!r} changes nothing here; keys begin with 'dataset.' or 'train.'.")
        stem = name if name in experiment_names() else Path(name).stem
        return cls(stem, load_experiment(name), profile, load_profile(profile), tuple(overrides))

    def runs(self, seeds: Collection[int] = ()) -> list[tuple[str, Recipe, int]]:
        """Row, recipe and seed of each run, in the order of the table.

        Args:
            seeds: replace the seeds that the rows name.
        """
        return [
            (name, recipe, seed)
            for name, row in self.experiment.rows.items()
            for recipe, declared in self.recipes(row).items()
            for seed in seeds or declared[: self.profile.seeds]
        ]

    def recipes(self, row: ExperimentRow) -> dict[Recipe, tuple[int, ...]]:
        """The recipes that train a row, and the seeds of each."""
        return self.experiment.recipes if row.recipes is None else row.recipes

    def settings(self, name: str) -> dict[str, dict[str, Any]]:
        """The configurations `dataset` and `train` of a row, not yet read by their models."""
        return apply_overrides(self._base, self.changes(name))

    def changes(self, name: str) -> list[str]:
        """The changes of a row, as KEY=VALUE."""
        return self.experiment.rows[name].overrides_in(self.profile_name)

    @property
    def common(self) -> list[str]:
        """The changes that all rows share, as KEY=VALUE."""
        return [*self.experiment.overrides_in(self.profile_name), *self.overrides]

    @cached_property
    def _base(self) -> dict[str, dict[str, Any]]:
        base = {"dataset": self.profile.dataset, "train": self.profile.train}
        return apply_overrides(base, self.common)
