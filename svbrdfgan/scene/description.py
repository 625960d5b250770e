"""A scene description as stored next to each exemplar: all that its picture depends on (thesis A.2), as JSON."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from svbrdfgan.config.choices import MOST_SAMPLES, FurtherMaps, PartSelection, PluginChoice, PluginField
from svbrdfgan.config.distributions import Color
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.types import Camera

MapValues = FurtherMaps[Annotated[float, Field(ge=0, le=1)]]
"""The value under the layer of each map that the layer paints besides base_color, by name; 0 is a flat `normal`."""


class AssetRef(StrictModel):
    """A file, relative to the folder of the scene or data set, and the hash of its content."""

    path: str = Field(description="relative to the folder of the scene or data set")
    sha256: str | None = Field(default=None, description="hash of the file's content; `null`: it is not checked")


class OrbitCamera(StrictModel):
    """A camera on a sphere about a target."""

    azimuth_degrees: float = Field(description="0 looks at the nose, 90 at the vehicle's left side (from +X)")
    elevation_degrees: Annotated[float, Field(ge=-89.9, le=89.9)] = Field(
        description="how far above the horizon the camera is, seen from the target"
    )
    distance: float = Field(gt=0, description="from the target, metres")
    target: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="the point in the middle of the picture, metres"
    )
    vertical_fov_degrees: float = Field(
        default=35.0, gt=0, lt=180, description="full angle over the height of the whole picture"
    )

    def camera(self) -> Camera:
        return Camera.orbit(
            math.radians(self.azimuth_degrees),
            math.radians(self.elevation_degrees),
            self.distance,
            self.target,
            math.radians(self.vertical_fov_degrees),
        )


class SceneEnvironment(StrictModel):
    """An environment map with its rotation and scale."""

    asset: AssetRef = Field(description="the map's file")
    rotation_degrees: float = Field(default=0.0, description="turn about the vertical")
    scale: float = Field(default=1.0, gt=0, description="multiplies the file's radiance")


class SceneModel(StrictModel):
    """A trained generator that paints layers, and the `Conditions` that it knows."""

    asset: AssetRef = Field(description="the generator's file")
    amounts: tuple[float, float] | None = Field(default=None, description="least and greatest amount that it knows")
    recipes: tuple[str, ...] = Field(default=(), description="the recipes that it knows")

    @property
    def conditions(self) -> Conditions:
        return Conditions(self.amounts, self.recipes)


class SceneWeathering(StrictModel):
    """The layer that the learnable parts carry: painted by a recipe, or by a model that learned it."""

    recipe: str = Field(description="the recipe's name")
    amount: float = Field(default=1.0, ge=0, le=1, description="0 is clean, 1 is filthy")
    seed: int = Field(default=0, description="seed of the pattern")
    options: dict[str, Any] = Field(default={}, description="the recipe's own options")
    model: SceneModel | None = Field(default=None, description="a trained generator that paints the layer instead")


class Scene(StrictModel):
    """The thesis's scene description Phi, which `svbrdfgan render` reads and every exemplar keeps as JSON."""

    mesh: AssetRef = Field(description="the mesh's file")
    environment: SceneEnvironment = Field(description="the light")
    camera: OrbitCamera = Field(description="the camera")
    width: int = Field(ge=1, description="of the picture, pixels")
    height: int = Field(ge=1, description="of the picture, pixels")
    spp: int = Field(default=64, ge=1, le=MOST_SAMPLES, description="samples per pixel")
    seed: int = Field(default=0, description="seed of the samples")
    texture: int = Field(default=256, ge=16, multiple_of=4, description="texels along a side of the layer")
    window: int | None = Field(
        default=None,
        ge=16,
        multiple_of=16,
        description="texels along a side of the square of the layer that is painted, where the picture shows most of "
        "it; the rest of the surface stays clean; `null`: the whole layer",
    )
    renderer: PluginField = Field(default=PluginChoice(name="auto"), description="as in `dataset.yaml`")
    embedding: PluginField = Field(default=PluginChoice(name="hemispherical"), description="as in `dataset.yaml`")
    learnable: PartSelection = Field(default=PartSelection(), description="the parts that carry the layer")
    materials: dict[str, Color] = Field(
        default={}, description="linear base colours by part; other parts keep the mesh's own"
    )
    maps: MapValues = Field(
        default={},
        description="maps that the layer paints besides base_color, with their values on the learnable parts under it; "
        "they also decide which maps of the mesh's file are rendered on other parts",
    )
    weathering: SceneWeathering | Literal["unknown"] | None = Field(
        default=None, description="`null`: none; `unknown`: that of an imported picture, which nobody described"
    )

    def save(self, path: Path) -> None:
        save_record(path, self)

    @classmethod
    def load(cls, path: Path) -> Scene:
        """Reads a scene file.

        Raises:
            AssetError: missing, or not JSON.
            ConfigError: a key is unknown or a value wrong.
        """
        return load_record(cls, path)


class _Maps(StrictModel):
    maps: MapValues


def map_values(data: dict[str, Any], source: str) -> dict[str, float]:
    """The values that the data give to further maps; `source` opens every message.

    Raises:
        ConfigError: a name is unknown or a value not in [0, 1].
    """
    return validate(_Maps, {"maps": data}, source).maps
