"""A trained run that paints a data set's layers: what it decides of the configuration, and its copy in the folder.

This module reads a run's files itself: rooms below training may not import it, and painting needs no more than the
generator and what its data set was.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from svbrdfgan.config.distributions import Fixed, UniformInteger, limits, mean, values_of
from svbrdfgan.config.models import validate
from svbrdfgan.data.conditions import conditions_of
from svbrdfgan.data.config import DatasetConfig, WeatheringDistribution
from svbrdfgan.data.gather import reference
from svbrdfgan.data.index import INDEX
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.records import load_json
from svbrdfgan.models.shipped import CONFIG, MODEL, model_folder, require_model
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.random_fields import MOST_SEEDS
from svbrdfgan.networks.saved import GeneratorConfig, load_generator
from svbrdfgan.scene.description import SceneModel, SceneWeathering

_COPY = Path("assets", "model")
_UNKNOWN = "unknown"
"""The recipe of layers whose model learned from pictures of unknown weathering, or is not told recipes apart."""
_MOST = 1_000_000
"""The greatest seed that is drawn if the configuration declares none."""

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class TrainedModel:
    """A run, as far as a data set must know it.

    Attributes:
        folder: of the run, or its copy.
        trained_on: the run's data set.
        conditions: what the generator is told of each layer.
        generator: the settings of its generator.
    """

    folder: Path
    trained_on: DatasetConfig
    conditions: Conditions
    generator: GeneratorConfig

    @property
    def stochastic(self) -> bool:
        """Whether its layers depend on a seed."""
        return self.generator.random_fields > 0

    @classmethod
    def open(cls, folder: Path, key: str = "weathering.model") -> TrainedModel:
        """The model of a run.

        Args:
            key: of the configuration that names it, for messages.

        Raises:
            AssetError: the folder is no run, or has no model yet.
        """
        path = folder / CONFIG
        try:
            require_model(folder)
        except AssetError as error:
            raise AssetError(f"{key}: {error}") from error
        data = load_json(path)
        try:
            dataset, generator = data["dataset"], data["train"]["generator"]
        except (KeyError, TypeError) as error:
            raise AssetError(f"{key}: {path} is not the configuration of a run.") from error
        trained_on = validate(DatasetConfig, dataset, str(path))
        config = validate(GeneratorConfig, generator, str(path))
        load_generator(folder / MODEL)  # its faults are found before anything is written
        return cls(folder, trained_on, conditions_of(config, trained_on), config)

    def store(self, folder: Path) -> SceneModel:
        """Stores a copy of the model among the folder's assets.

        Raises:
            AssetError: it cannot be read or written.
        """
        for name in (CONFIG, MODEL):
            with atomic_path(folder / _COPY / name) as temporary:
                temporary.write_bytes((self.folder / name).read_bytes())
        known = self.conditions
        return SceneModel(asset=reference(folder / _COPY / MODEL, folder), amounts=known.amount, recipes=known.recipes)

    def weatherings(self, stored: SceneModel, count: int) -> list[SceneWeathering]:
        """Some that the model was trained on, by its copy in a folder; one if it paints one layer on a mesh."""
        drawn = WeatheringDistribution(**self._weathering())
        return [
            SceneWeathering(
                recipe=drawn.recipe.sample(rng),
                amount=min(max(drawn.amount.sample(rng), 0.0), 1.0),
                seed=drawn.seed.sample(rng),
                model=stored,
            )
            for rng in map(np.random.default_rng, range(count if self.stochastic else 1))
        ]

    def fill(self, config: DatasetConfig) -> DatasetConfig:
        """The configuration with what it leaves out: what the generator was trained with.

        Raises:
            ConfigError: it contradicts that, or asks for what the model does not know.
        """
        keys = ("embedding", "texture", "maps", "learnable")
        taken = {key: getattr(self.trained_on, key) for key in keys if key not in config.model_fields_set}
        filled = config.model_copy(update=taken)
        self._require("embedding", filled.embedding.model_dump(), self.trained_on.embedding.model_dump())
        self._require("texture", filled.texture, self.trained_on.texture)
        self._require("maps", list(filled.maps), list(self.trained_on.maps))
        assert config.weathering is not None
        return filled.model_copy(update={"weathering": self._filled_weathering(config.weathering)})

    def _filled_weathering(self, declared: WeatheringDistribution) -> WeatheringDistribution:
        defaults = self._weathering()
        taken = {key: value for key, value in defaults.items() if key not in declared.model_fields_set}
        filled = declared.model_copy(update=taken)
        if filled.recipe != defaults["recipe"]:
            for recipe in values_of(filled.recipe):
                self._choose("recipe", recipe=recipe)
        if filled.amount != defaults["amount"]:
            low, high = limits(filled.amount, 0.0, 1.0)
            self._choose("amount", amount=low)
            self._warn_beyond(low, high)
        if filled.seed != defaults["seed"]:
            self._require_seeds(*limits(filled.seed, float("-inf"), float("inf")))  # type: ignore[arg-type]  # of integers
        return filled

    def _weathering(self) -> dict[str, Any]:
        """The distributions for what the data set does not say: amounts and recipes as in training, and any seed."""
        learned, known = self.trained_on.weathering, self.conditions
        amount: Any = WeatheringDistribution().amount if learned is None else learned.amount
        return {
            "recipe": learned.recipe if learned is not None and known.recipes else Fixed[str](fixed=_UNKNOWN),
            "amount": amount if known.amount is not None else Fixed[float](fixed=min(max(mean(amount), 0.0), 1.0)),
            "seed": UniformInteger(uniform=(0, _MOST)) if self.stochastic else Fixed[int](fixed=0),
        }

    def _require(self, key: str, given: object, wanted: object) -> None:
        if given != wanted:
            raise ConfigError(f"{key}: the model was trained with {wanted}, not {given}: leave the key out.")

    def _choose(self, key: str, *, amount: float | None = None, recipe: str | None = None) -> None:
        """Refuses what the model does not know, in the words of every command that asks a model."""
        several = len(self.conditions.recipes) > 1
        asked = recipe or (self.conditions.recipes[0] if several else None)
        try:
            self.conditions.choose(amount, asked)
        except ConfigError as error:
            raise ConfigError(f"weathering.{key}: {error}") from error

    def _warn_beyond(self, low: float, high: float) -> None:
        known = self.conditions.amount
        if known is not None and not known[0] <= low <= high <= known[1]:
            log.warning("weathering.amount is beyond what the model was trained on: %g to %g", *known)

    def _require_seeds(self, low: float, high: float) -> None:
        if not self.stochastic:
            raise ConfigError(
                "weathering.seed: the model has no random fields, and so paints one layer on a mesh: leave out the "
                "seed, or train with generator.random_fields on exemplars of different seeds."
            )
        if not 0 <= low <= high < MOST_SEEDS:
            given = low if low < 0 else high
            raise ConfigError(
                f"weathering.seed: {given:.0f} is not allowed; wanted whole numbers from 0 to {MOST_SEEDS - 1}."
            )


def with_model(config: DatasetConfig, folder: Path | None, base: Path) -> DatasetConfig:
    """The configuration with all that its model decides; itself if there is no model.

    Args:
        folder: of the data set; if it was begun there, its own copy of the model counts, and the run need not be there.
        base: the folder that the model's path is relative to.

    Raises:
        ConfigError: the configuration contradicts the model's training, or asks for what it does not know.
        AssetError: the model cannot be read.
    """
    if config.weathering is None or config.weathering.model is None:
        return config
    begun = folder is not None and _copied(config, folder)
    return TrainedModel.open(folder / _COPY if folder and begun else _run_of(config, base)).fill(config)


def gather_model(config: DatasetConfig, folder: Path, base: Path) -> SceneModel | None:
    """Stores a copy of the configuration's model, if it has one, among the folder's assets.

    Raises:
        AssetError: it cannot be read or written.
    """
    if config.weathering is None or config.weathering.model is None:
        return None
    return TrainedModel.open(_run_of(config, base)).store(folder)


def warn_of_new_model(stored: SceneModel | None, config: DatasetConfig, base: Path) -> None:
    """Warns if the run has another model now than the data set, which goes on with its own."""
    if stored is None:
        return
    run = _run_of(config, base)
    if (run / MODEL).is_file() and reference(run / MODEL, run).sha256 != stored.asset.sha256:
        log.warning("%s has another model now; the data set goes on with its copy of the earlier one.", run)


def _run_of(config: DatasetConfig, base: Path) -> Path:
    assert config.weathering is not None
    assert config.weathering.model is not None
    return model_folder(config.weathering.model, base)


def _copied(config: DatasetConfig, folder: Path) -> bool:
    """Whether a data set of the same model was begun in the folder."""
    if not (folder / INDEX).is_file() or not (folder / _COPY / MODEL).is_file():
        return False
    assert config.weathering is not None
    try:
        begun = load_json(folder / INDEX)["config"]["weathering"]["model"]
    except (KeyError, TypeError):  # no data set of a model
        return False
    return bool(begun == config.weathering.model)
