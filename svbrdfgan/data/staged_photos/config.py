"""The configuration of staged photographs: a data set, and how its scenes are photographed."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from svbrdfgan.config.distributions import Choice, Integer, Name, Number, Uniform, values_of, within
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, ProceduralSkies

RAW = "Raw"
VIEWS = ("AgX", "Filmic", "Standard", RAW)
"""Blender's view transforms that look like a camera's, and no curve at all."""
F_NUMBER = (0.5, 1000.0)
CAMERA_ERROR = (-0.9, 9.0)
SHARE = (0.0, 1.0)
FLASH = (0.01, 100.0)
"""Bounds; draws of `normal` beyond are clamped, too."""


class Photography(StrictModel):
    """How a photographer and a camera make pictures of scenes."""

    samples: int = Field(default=64, ge=1, description="of Cycles in each pixel; what noise they leave stays")
    bounces: int = Field(default=8, ge=0, description="of light; 0 is light from the environment alone")
    view: Name = Field(
        default=Choice[str](choice=("AgX", "Filmic")),
        description="Blender's view transform, the camera's tone curve: `AgX`, `Filmic` or `Standard` (plain sRGB); "
        "`Raw` writes linear EXR files instead of JPEG",
    )
    exposure_stops: Number = Field(
        default=Uniform(uniform=(-0.5, 0.5)),
        description="beyond that of a light meter, which makes the mean of log luminance 18 % grey",
    )
    white_balance: Annotated[Number, within(*SHARE)] = Field(
        default=Uniform(uniform=(0.5, 1.0)),
        description="how much of the light's colour the camera takes out: 0 nothing, 1 all",
    )
    f_number: Annotated[Number, within(*F_NUMBER)] = Field(
        default=Uniform(uniform=(2.8, 8.0)),
        description="of a 24 mm high sensor, for depth of field; the camera focuses on its target",
    )
    noise: Annotated[Number, within(*SHARE)] = Field(
        default=Uniform(uniform=(0.005, 0.02)),
        description="of the sensor: its deviation at 18 % grey, before the curve",
    )
    jpeg_quality: Annotated[Integer, within(1, 100)] = Field(
        default=Choice[int](choice=(85, 90, 95)), description="1 to 100"
    )
    ground: bool = Field(default=True, description="stands the mesh on a rough floor")
    background: bool = Field(default=True, description="shows the environment behind it; `false`: black")
    pairs: Literal["before", "flash"] | None = Field(
        default=None,
        description="takes two pictures from each place with one exposure: `before`, also of the clean mesh; `flash`, "
        "also with a flash beside the lens",
    )
    flash: Annotated[Number, within(*FLASH)] = Field(
        default=Uniform(uniform=(0.5, 1.0)),
        description="how bright it makes white paper at the target's distance, before the curve",
    )
    masks: Annotated[float, Field(ge=0, le=1)] = Field(default=1.0, description="share of the pictures with a mask")
    camera_error_degrees: Number = Field(
        default=Uniform(uniform=(-1.0, 1.0)), description="of azimuth and elevation in the manifest, each"
    )
    camera_error: Annotated[Number, within(*CAMERA_ERROR)] = Field(
        default=Uniform(uniform=(-0.01, 0.01)), description="of the distance in the manifest, as a share of it"
    )
    pool: EnvironmentSource = Field(
        default=EnvironmentSource(procedural=ProceduralSkies(count=12, seed=7)),
        description="the maps from which whoever imports the pictures estimates their light",
    )

    @model_validator(mode="after")
    def _is_known(self) -> Photography:
        if strange := [name for name in values_of(self.view) if name not in VIEWS]:
            raise ValueError(f"view: {strange[0]!r} is not known; known are {', '.join(VIEWS)}")
        return self


class StagedPhotosConfig(DatasetConfig):
    """A data set whose scenes are photographed."""

    photography: Photography = Field(default=Photography(), description="how its scenes are photographed")

    @property
    def dataset(self) -> DatasetConfig:
        """The data set that renders the same scenes."""
        return DatasetConfig(**{name: getattr(self, name) for name in DatasetConfig.model_fields})

    @model_validator(mode="after")
    def _shows_weathering(self) -> StagedPhotosConfig:
        if self.weathering is None:
            raise ValueError("weathering is null: name what the photographs show")
        return self


def staged_photos_config(data: dict[str, Any], source: str) -> StagedPhotosConfig:
    """The configuration that the data describe; `source` opens every message.

    Raises:
        ConfigError: one line for each fault.
    """
    return validate(StagedPhotosConfig, data, source)
