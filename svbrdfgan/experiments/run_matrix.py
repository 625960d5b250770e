"""The runs of an experiment: every row with each of its recipes and seeds, and the resolved configuration of each."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import get_args

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import StrictModel
from svbrdfgan.config.yaml_files import apply_overrides
from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, Split, dataset_config
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.definition import Recipe
from svbrdfgan.experiments.plan import Plan
from svbrdfgan.training.config import TrainConfig, resolved, train_config
from svbrdfgan.training.resolve import learns_distribution

_PLACEHOLDER = "dataset"
"""Stands for the data set's folder, which is chosen together with the run's folder."""
_ADVERSARIAL = ("recipe", "discriminator", "loss", "optimizer", "batch_size", "rendering")
"""Keys that an adversarial oracle has from its run; pictures of it are rendered as the discriminator needs."""


class DatasetSpec(StrictModel):
    """Everything that a data set depends on."""

    dataset: DatasetConfig


class OracleSpec(StrictModel):
    """Everything that an oracle depends on: the data, the run of one step that it belongs to, and its own steps.

    Attributes:
        minutes: the most time for an adversarial oracle, which trains as long as the runs that it is compared with.
    """

    dataset: DatasetConfig
    train: TrainConfig
    steps: int
    minutes: float | None = None


class RunSpec(StrictModel):
    """Everything that the outcome of a run depends on. Paths are relative to the assets."""

    train: TrainConfig
    oracle: OracleSpec

    @property
    def dataset(self) -> DatasetConfig:
        return self.oracle.dataset

    @property
    def files(self) -> list[str]:
        """Patterns of the asset files that the run needs."""
        config, scenes = self.dataset, self.train.scenes
        sources = [split.meshes for split in config.splits.values()]
        lights = [config.environments, *(split.environments for split in config.splits.values()), scenes.environment]
        found = [pattern for source in sources for pattern in source.files]
        return found + [p for light in lights if isinstance(light, EnvironmentSource) for p in light.files]


@dataclass(frozen=True)
class Cell:
    """One run of an experiment.

    Attributes:
        oracle: whether it is scored beside an oracle.
    """

    experiment: str
    row: str
    recipe: Recipe
    seed: int
    spec: RunSpec
    oracle: bool

    @property
    def title(self) -> str:
        return f"{self.row}, {self.recipe}, seed {self.seed}"

    def matches(self, pattern: str) -> bool:
        """Whether EXPERIMENT/ROW/RECIPE/SEED, or its first parts, names this run. Parts may be shell patterns."""
        mine, wanted = (self.experiment, self.row, self.recipe, str(self.seed)), pattern.split("/")
        return len(wanted) <= len(mine) and all(map(fnmatchcase, mine, wanted))


class RunMatrix(Plan):
    """An experiment in a profile, and the resolved configuration of each of its runs."""

    def cells(self, seeds: Collection[int] = ()) -> list[Cell]:
        """The runs, in the order of the table.

        Args:
            seeds: replace the seeds that the rows name.

        Raises:
            ConfigError: the configuration of a row is wrong.
        """
        return [self.cell(*run) for run in self.runs(seeds)]

    def cell(self, name: str, recipe: Recipe, seed: int) -> Cell:
        """One run.

        Raises:
            ConfigError: its configuration is wrong; one line for each error.
        """
        data = self.settings(name)
        source = f"{self.name}, row {name}"
        dataset = dataset_config(data["dataset"], source)
        lacking = [split for split in get_args(Split) if split not in dataset.splits]
        if lacking:
            raise ConfigError(f"{source}: dataset.splits lacks {' and '.join(lacking)}, on which runs are scored.")
        fixed = {"recipe": recipe, "seed": seed, "dataset": _PLACEHOLDER}
        train = resolved(train_config({**data["train"], **fixed}, source), dataset.spp, dataset.maps)
        spec = RunSpec(train=train, oracle=self._oracle(dataset, train))
        return Cell(self.name, name, recipe, seed, spec, self.experiment.oracles)

    def _oracle(self, dataset: DatasetConfig, train: TrainConfig) -> OracleSpec:
        """The oracle of a run. A supervised one depends on data and generator alone: rows with other changes share it.

        The oracle of a distribution is trained adversarially, by the run's own discriminator, loss and optimizers.
        """
        base = apply_overrides({"train": self.profile.train}, (o for o in self.overrides if o.startswith("train.")))
        fixed = {"seed": 0, "dataset": _PLACEHOLDER, "steps": 1, "minutes": None}
        same = train_config({**base["train"], **fixed}, self.name).model_copy(update={"generator": train.generator})
        if not learns_distribution(train.generator, dataset):
            return OracleSpec(dataset=dataset, train=same, steps=self.profile.oracle_steps)
        adversarial = same.model_copy(update={name: getattr(train, name) for name in _ADVERSARIAL})
        return OracleSpec(dataset=dataset, train=adversarial, steps=train.steps, minutes=train.minutes)


def select_cells(cells: Sequence[Cell], patterns: Sequence[str]) -> list[Cell]:
    """The cells that match, in the order of the patterns; all cells if there are no patterns.

    Raises:
        ConfigError: a pattern matches no cell.
    """
    if not patterns:
        return list(cells)
    selected: list[Cell] = []
    for pattern in patterns:
        matching = [cell for cell in cells if cell.matches(pattern)]
        if not matching:
            known = list(dict.fromkeys(f"{cell.experiment}/{cell.row}" for cell in cells))
            hint = did_you_mean(pattern, known) or f"; there are {', '.join(known)}."
            raise ConfigError(f"no run matches {pattern!r}{hint}")
        selected += [cell for cell in matching if cell not in selected]
    return selected
