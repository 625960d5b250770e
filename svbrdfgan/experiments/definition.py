"""The models of experiments' YAML files, and of the profiles, which set the size of data and training."""

from __future__ import annotations

import json
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal, TypeVar

from pydantic import Field

from svbrdfgan.config.error_messages import did_you_mean
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.errors import ConfigError

Recipe = Literal["default", "thesis"]
ProfileName = Literal["cpu", "gpu"]
Measure = Literal["shown", "unseen", "gradient_noise", "octaves"]

Record = TypeVar("Record", bound=StrictModel)


class Changes(StrictModel):
    """Values by dotted key that override the configurations of the data set and the training."""

    dataset: dict[str, Any] = Field(default={}, description="changes of `dataset.yaml` by dotted key")
    train: dict[str, Any] = Field(default={}, description="changes of `train.yaml` by dotted key")

    def overrides(self) -> list[str]:
        """The changes as KEY=VALUE; keys begin with `dataset.` or `train.`."""
        groups = {"dataset": self.dataset, "train": self.train}
        return [
            f"{group}.{key}={json.dumps(value)}" for group, changes in groups.items() for key, value in changes.items()
        ]


class _Changed(Changes):
    """Changes for all profiles, and further changes for each profile."""

    cpu: Changes = Field(default=Changes(), description="further changes in the profile `cpu`")
    gpu: Changes = Field(default=Changes(), description="further changes in the profile `gpu`")

    def overrides_in(self, profile: ProfileName) -> list[str]:
        return self.overrides() + (self.cpu if profile == "cpu" else self.gpu).overrides()


class ExperimentRow(_Changed):
    """A row of the table."""

    about: str = Field(description="what the row changes, for readers of the table")
    recipes: dict[Recipe, tuple[int, ...]] | None = Field(
        default=None, description="training recipes and the seeds of each; `null`: those of the experiment"
    )


class Experiment(_Changed):
    """An experiment: the changes that all rows share, and the rows."""

    title: str = Field(description="what the experiment is, for readers of the table")
    figure: str = Field(description="the figure or section of the thesis that it reproduces")
    thesis: str = Field(description="what the thesis found")
    recipes: dict[Recipe, tuple[int, ...]] = Field(
        default={"default": (0,), "thesis": (0,)},
        description="training recipes and the seeds of each; a profile may take fewer seeds",
    )
    measures: tuple[Measure, ...] = Field(
        default=(),
        description="further columns of the table: `recovered` on the part of the learnable area that the training's "
        "cameras would see, on the rest of it, the noise of the gradient, and the power in each octave",
    )
    oracles: bool = Field(
        default=True, description="whether runs are scored beside an oracle, which takes about as long to train as one"
    )
    rows: dict[str, ExperimentRow] = Field(min_length=1, description="the rows of the table by name")


class ExperimentProfile(StrictModel):
    """The size of data and training.

    Attributes:
        about: the vehicles, the light and the budget of a run, in words.
        seeds: greatest number of seeds of each row.
        oracle_steps: greatest number of the oracle's steps, even if its score still rises.
        dataset, train: configurations to which experiments apply their changes.
    """

    about: str
    seeds: int = Field(ge=1)
    oracle_steps: int = Field(ge=1)
    dataset: dict[str, Any]
    train: dict[str, Any]


def experiment_names() -> list[str]:
    """Names of the shipped experiments, sorted."""
    files = (file.name for file in (_shipped() / "definitions").iterdir())
    return sorted(name.removesuffix(".yaml") for name in files if name.endswith(".yaml"))


def load_experiment(name: str) -> Experiment:
    """A shipped experiment by its name, or one of the user's by the path of its YAML file.

    Raises:
        ConfigError: there is no such experiment, or its file is wrong; one line for each error.
    """
    if name.endswith((".yaml", ".yml")):
        return validate(Experiment, load_yaml(Path(name)), name)
    known = experiment_names()
    if name not in known:
        hint = did_you_mean(name, known) or f"; known are {', '.join(known)}, or give the path of a YAML file."
        raise ConfigError(f"there is no experiment {name!r}{hint}")
    return _read(Experiment, "definitions", name)


def load_profile(name: ProfileName) -> ExperimentProfile:
    """A shipped profile."""
    return _read(ExperimentProfile, "profiles", name)


def _read(model: type[Record], folder: str, name: str) -> Record:
    with resources.as_file(_shipped() / folder / f"{name}.yaml") as path:
        return validate(model, load_yaml(path), path.name)


def _shipped() -> Traversable:
    return resources.files("svbrdfgan.experiments")
