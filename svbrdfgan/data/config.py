"""The configuration of a data set, as written in YAML. `docs/quickstart.md` shows a file with every key."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from svbrdfgan.config.choices import FurtherMaps, PartSelection, PluginChoice, PluginField
from svbrdfgan.config.distributions import Choice, Color, Fixed, Integer, Name, Number, Paint, Uniform, within
from svbrdfgan.config.models import StrictModel, validate

Split = Literal["train", "validation", "test"]
Label = Literal["weathered", "parts", "depth", "normals"]


class ProceduralMeshes(StrictModel):
    """Procedural vehicles. Each seed gives other vehicles; splits need different seeds."""

    count: int = Field(ge=1)
    kinds: tuple[str, ...] = Field(default=("sedan", "hatchback", "van", "pickup"), min_length=1)
    seed: int = Field(default=0, ge=0, lt=2**63)


class ProceduralSkies(StrictModel):
    """Procedural skies (outdoor) or rooms (indoor), whose light is of another kind."""

    count: int = Field(ge=1)
    kind: Literal["outdoor", "indoor"] = "outdoor"
    seed: int = Field(default=0, ge=0, lt=2**63)


class MeshSource(StrictModel):
    """Meshes of a split: files (shell patterns, relative to the configuration file), procedural ones, or both."""

    files: tuple[str, ...] = ()
    procedural: ProceduralMeshes | None = None


class EnvironmentSource(StrictModel):
    """Environment maps of a split: files (shell patterns), procedural ones, or both."""

    files: tuple[str, ...] = ()
    procedural: ProceduralSkies | None = None


ELEVATION, DISTANCE, FIELD_OF_VIEW, BRIGHTNESS = (-89.0, 89.0), (0.05, math.inf), (1.0, 170.0), (1e-6, math.inf)
"""Smallest and largest allowed values. Draws of `normal` beyond them are clamped."""


class CameraDistribution(StrictModel):
    """Cameras on a sphere about the middle of the mesh's bounding box.

    `distance` counts in units of the distance from which the bounding sphere just fits the picture.
    """

    azimuth_degrees: Number = Uniform(uniform=(0.0, 360.0))
    elevation_degrees: Annotated[Number, within(*ELEVATION)] = Uniform(uniform=(5.0, 35.0))
    distance: Annotated[Number, within(*DISTANCE)] = Fixed[float](fixed=0.9)
    vertical_fov_degrees: Annotated[Number, within(*FIELD_OF_VIEW)] = Fixed[float](fixed=35.0)


class SplitConfig(StrictModel):
    """One of train, validation and test."""

    meshes: MeshSource
    environments: EnvironmentSource | None = None
    camera: CameraDistribution | None = None
    views: int = Field(default=8, ge=1, description="pictures of each mesh")

    @model_validator(mode="after")
    def _has_meshes(self) -> SplitConfig:
        if not self.meshes.files and self.meshes.procedural is None:
            raise ValueError("meshes needs 'files', 'procedural' or both")
        return self


class WeatheringDistribution(StrictModel):
    """The ground-truth generator G0 (thesis 4.2). A fixed seed makes the layer a function of the geometry.

    `options` must suit each of the recipes. With `model`, the folder of a run, its generator paints the layers instead;
    `svbrdfgan.data.trained_model` fills in what is left out.
    """

    recipe: Name = Fixed[str](fixed="road-dirt")
    amount: Annotated[Number, within(0, 1)] = Fixed[float](fixed=1.0)
    seed: Integer = Fixed[int](fixed=0)
    options: dict[str, Any] = {}
    model: str | None = None

    @model_validator(mode="after")
    def _has_options(self) -> WeatheringDistribution:
        if self.model is not None and self.options:
            raise ValueError("options are those of recipes, and with 'model' a generator paints: leave out one of them")
        return self


PAINTS = (
    *((0.45, 0.02, 0.02), (0.02, 0.06, 0.30), (0.70, 0.70, 0.70), (0.03, 0.16, 0.06)),
    *((0.60, 0.38, 0.03), (0.08, 0.08, 0.09), (0.20, 0.32, 0.45), (0.42, 0.13, 0.03)),
)
"""Linear reflectances of common car paints."""


class DatasetConfig(StrictModel):
    """A whole data set. One of imported pictures has no `weathering`, since theirs is unknown."""

    seed: int = Field(default=0, ge=0, lt=2**63)
    image: tuple[Annotated[int, Field(ge=8, le=8192)], Annotated[int, Field(ge=8, le=8192)]] = (256, 256)
    texture: int = Field(default=256, ge=16, le=4096, multiple_of=4)
    spp: int = Field(default=64, ge=1)
    renderer: PluginField = PluginChoice(name="auto")
    embedding: PluginField = PluginChoice(name="hemispherical")
    learnable: PartSelection = PartSelection()
    paint: Annotated[Paint, within(0, 1)] | None = Choice[Color](choice=PAINTS)
    maps: FurtherMaps[Annotated[Number, within(0, 1)]] = {}
    environments: EnvironmentSource = EnvironmentSource(procedural=ProceduralSkies(count=8))
    environment_rotation_degrees: Number = Uniform(uniform=(0.0, 360.0))
    environment_rows: int = Field(default=256, ge=8, description="larger maps are shrunk, keeping their energy")
    environment_brightness: Annotated[Number, within(*BRIGHTNESS)] = Fixed[float](fixed=1.0)
    camera: CameraDistribution = CameraDistribution()
    weathering: WeatheringDistribution | None = WeatheringDistribution()
    labels: tuple[Label, ...] = ()
    splits: dict[Split, SplitConfig]

    @model_validator(mode="after")
    def _trains(self) -> DatasetConfig:
        if "train" not in self.splits:
            raise ValueError("splits needs 'train'")
        return self

    def camera_of(self, split: Split) -> CameraDistribution:
        """The cameras of the split."""
        return self.splits[split].camera or self.camera


def dataset_config(data: dict[str, Any], source: str) -> DatasetConfig:
    """The configuration that the data describe; `source` opens every message.

    Raises:
        ConfigError: one line for each fault.
    """
    return validate(DatasetConfig, data, source)
