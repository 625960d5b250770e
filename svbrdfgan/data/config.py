"""The configuration of a data set, as written in YAML. `docs/configuration.md` lists every key."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from svbrdfgan.config.choices import MOST_SAMPLES, FurtherMaps, PartSelection, PluginChoice, PluginField
from svbrdfgan.config.distributions import (
    Choice,
    Color,
    Fixed,
    Integer,
    LogUniform,
    Name,
    Number,
    Paint,
    Uniform,
    within,
)
from svbrdfgan.config.models import StrictModel, validate

Split = Literal["train", "validation", "test"]
Label = Literal["weathered", "parts", "depth", "normals"]


class ProceduralMeshes(StrictModel):
    """Procedural vehicles."""

    count: int = Field(ge=1, le=100_000, description="vehicles to make")
    kinds: tuple[str, ...] = Field(
        default=("sedan", "hatchback", "van", "pickup"), min_length=1, description="taken in turn"
    )
    seed: int = Field(default=0, ge=0, lt=2**63, description="other seeds, other vehicles; give each split its own")


class ProceduralSkies(StrictModel):
    """Procedural environment maps."""

    count: int = Field(ge=1, le=10_000, description="maps to make")
    kind: Literal["outdoor", "indoor"] = Field(
        default="outdoor", description="`outdoor`: skies with a sun; `indoor`: rooms with lamps overhead"
    )
    seed: int = Field(default=0, ge=0, lt=2**63, description="other seeds, other skies")


class MeshSource(StrictModel):
    """Meshes of a split: files, procedural ones, or both."""

    files: tuple[str, ...] = Field(default=(), description="shell patterns, relative to this file")
    procedural: ProceduralMeshes | None = Field(default=None, description="vehicles made from a seed")


class EnvironmentSource(StrictModel):
    """Environment maps: files, procedural ones, or both."""

    files: tuple[str, ...] = Field(default=(), description="shell patterns, relative to this file")
    procedural: ProceduralSkies | None = Field(default=None, description="skies or rooms made from a seed")


ELEVATION = (-89.0, 89.0)
"""Degrees: a camera straight above or below would have no direction that is up."""
DISTANCE = (0.05, math.inf)
CLOSE_DISTANCE = (0.005, math.inf)
"""Of close-ups, which look at the surface itself: 4 cm from a car."""
FIELD_OF_VIEW = (1.0, 170.0)
"""Degrees."""
BRIGHTNESS = (1e-6, math.inf)
"""Bounds of mean radiance: in the dark nothing could be learned. As above, draws of `normal` beyond are clamped."""


class CloseUps(StrictModel):
    """Pictures from near, of a point of the learnable surface that is seen from within 30 degrees of its normal."""

    share: float = Field(default=0.5, gt=0.0, le=1.0, description="of the pictures; the others show the whole")
    distance: Annotated[Number, within(*CLOSE_DISTANCE)] = Field(
        default=LogUniform(log_uniform=(0.06, 0.4)),
        description="from the point, in the units of the camera's own `distance`, at least 0.005",
    )
    window: int | None = Field(
        default=None,
        ge=16,
        le=4096,
        multiple_of=16,
        description="texels along a side of the square of the layer that is baked and painted for a close-up, at most "
        "`texture`: where the picture shows most of the layer; the rest stays clean; `null`: the whole layer",
    )


class CameraDistribution(StrictModel):
    """Cameras on a sphere about a point in the mesh's bounding box."""

    azimuth_degrees: Number = Field(
        default=Uniform(uniform=(0.0, 360.0)),
        description="0 looks at the nose, 90 at the vehicle's left side (from +X)",
    )
    elevation_degrees: Annotated[Number, within(*ELEVATION)] = Field(
        default=Uniform(uniform=(5.0, 35.0)), description="height over the horizon, -89 to 89"
    )
    distance: Annotated[Number, within(*DISTANCE)] = Field(
        default=Fixed[float](fixed=0.9),
        description="in units of the distance from which the mesh's bounding sphere just fits the picture, at least "
        "0.05",
    )
    vertical_fov_degrees: Annotated[Number, within(*FIELD_OF_VIEW)] = Field(
        default=Fixed[float](fixed=35.0), description="full vertical angle, 1 to 170"
    )
    spread: float = Field(
        default=0.0,
        ge=0.0,
        le=1.0,
        description="share of the box in which the point that a camera looks at lies, evenly distributed about the "
        "middle; 0: the middle itself; more where cameras are close, so that they see all parts",
    )
    close_ups: CloseUps | None = Field(
        default=None, description="[close-ups](commands.md#close-ups) among the pictures; `null`: none"
    )


class SplitConfig(StrictModel):
    """A split: train, validation or test."""

    meshes: MeshSource = Field(description="the meshes of this split")
    environments: EnvironmentSource | None = Field(
        default=None, description="light of this split alone; `null`: that of the data set"
    )
    camera: CameraDistribution | None = Field(
        default=None, description="cameras of this split alone; `null`: those of the data set"
    )
    views: int = Field(default=8, ge=1, le=1_000_000, description="pictures of each mesh")

    @model_validator(mode="after")
    def _has_meshes(self) -> SplitConfig:
        if not self.meshes.files and self.meshes.procedural is None:
            raise ValueError("meshes needs 'files', 'procedural' or both")
        return self


class WeatheringDistribution(StrictModel):
    """The ground-truth generator G0 (thesis 4.2), or with `model` a trained one (`svbrdfgan.data.trained_model`)."""

    recipe: Name = Field(
        default=Fixed[str](fixed="road-dirt"), description="such as `rust`; [all](commands.md#recipes)"
    )
    amount: Annotated[Number, within(0, 1)] = Field(
        default=Fixed[float](fixed=1.0), description="0 is clean, 1 is filthy"
    )
    seed: Integer = Field(
        default=Fixed[int](fixed=0),
        description="a fixed one makes the layer a function of the geometry, which can be learned exactly",
    )
    options: dict[str, Any] = Field(
        default={},
        description="the recipe's own options, such as `{reach: 0.5}`; of several recipes, only those that all of "
        "them have",
    )
    model: str | None = Field(
        default=None,
        description="a shipped model's name, or the folder of a run, whose generator paints the layers instead of a "
        "recipe; what this section leaves out is as in its training",
    )

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


Pixels = Annotated[int, Field(ge=8, le=8192)]


class SharedConfig(StrictModel):
    """Keys that data sets and manifests of pictures share."""

    image: tuple[Pixels, Pixels] = Field(default=(256, 256), description="width and height of the pictures, pixels")
    texture: int = Field(
        default=256, ge=16, le=4096, multiple_of=4, description="texels along a side of geometry buffers and layers"
    )
    renderer: PluginField = Field(
        default=PluginChoice(name="auto"),
        description="a name, or `{name: warp, device: cpu}` with the renderer's options; `auto`: the fastest that "
        "works and reads all `maps`",
    )
    embedding: PluginField = Field(
        default=PluginChoice(name="hemispherical"),
        description="a UV embedding's name, or `{name: hemispherical, resolution: 128}` with its options",
    )
    learnable: PartSelection = Field(default=PartSelection(), description="the parts of a mesh that carry the layer")
    environments: EnvironmentSource = Field(
        default=EnvironmentSource(procedural=ProceduralSkies(count=8)), description="the light"
    )
    environment_rotation_degrees: Number = Field(
        default=Uniform(uniform=(0.0, 360.0)), description="turn of the light about the vertical"
    )
    environment_rows: int = Field(
        default=256, ge=8, description="rows to which larger maps are shrunk, keeping their energy"
    )
    environment_brightness: Annotated[Number, within(*BRIGHTNESS)] = Field(
        default=Fixed[float](fixed=1.0),
        description="mean radiance: each map is first scaled to a mean of 1, then multiplied by this, at least 1e-6",
    )


class DatasetConfig(SharedConfig):
    """A data set: pictures of weathered meshes, rendered or imported."""

    seed: int = Field(default=0, ge=0, lt=2**63, description="seed of all random draws")
    spp: int = Field(default=64, ge=1, le=MOST_SAMPLES, description="samples per pixel of the exemplars")
    paint: Annotated[Paint, within(0, 1)] | None = Field(
        default=Choice[Color](choice=PAINTS),
        description="linear base colour of the learnable parts, 0 to 1; by default one of eight car paints; `null`: "
        "the mesh's own",
    )
    maps: FurtherMaps[Annotated[Number, within(0, 1)]] = Field(
        default={},
        description="maps that layers paint besides base_color, each with its value on clean learnable parts, 0 to 1, "
        "such as `{roughness: {uniform: [0.2, 0.5]}, metallic: 0, normal: 0}`; `normal: 0` is flat, and `metallic` "
        "needs `roughness`; other parts have what their file says of these maps, and glass its alpha",
    )
    camera: CameraDistribution = Field(default=CameraDistribution(), description="cameras of all splits")
    weathering: WeatheringDistribution | None = Field(
        default=WeatheringDistribution(),
        description="the weathering that exemplars show, which training is to recover; `null` for imported pictures, "
        "whose weathering is unknown",
    )
    labels: tuple[Label, ...] = Field(
        default=(), description="[labels](commands.md#labels) to write next to each picture"
    )
    splits: dict[Split, SplitConfig] = Field(description="`train`, and `validation` and `test` where wanted")

    @model_validator(mode="after")
    def _trains(self) -> DatasetConfig:
        if "train" not in self.splits:
            raise ValueError("splits needs 'train'")
        return self

    @model_validator(mode="after")
    def _has_windows(self) -> DatasetConfig:
        windows = [near.window for split in self.splits if (near := self.camera_of(split).close_ups) and near.window]
        if windows and max(windows) > self.texture:
            raise ValueError(f"close_ups.window is {max(windows)}, and texture {self.texture}; wanted at most that")
        if windows and self.weathering is not None and self.weathering.model is not None:
            raise ValueError("a model paints whole layers: leave out close_ups.window")
        return self

    @property
    def windowed(self) -> bool:
        """Whether the pictures of all splits show windows."""
        return all((near := self.camera_of(split).close_ups) and near.window for split in self.splits)

    @property
    def window(self) -> int | None:
        """Texels along a side of the windows that training sees; None if it sees whole maps."""
        near = self.camera_of("train").close_ups
        return None if near is None else near.window

    def camera_of(self, split: Split) -> CameraDistribution:
        """The cameras of the split."""
        return self.splits[split].camera or self.camera


def dataset_config(data: dict[str, Any], source: str) -> DatasetConfig:
    """The configuration that the data describe; `source` opens every message.

    Raises:
        ConfigError: one line for each fault.
    """
    return validate(DatasetConfig, data, source)
