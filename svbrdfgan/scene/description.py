"""A scene description as stored beside each exemplar: all that its picture depends on (thesis A.2), as JSON."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from svbrdfgan.config.choices import FurtherMaps, PartSelection, PluginChoice, PluginField
from svbrdfgan.config.distributions import Color
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.io.records import load_record, save_record
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.types import Camera

MapValues = FurtherMaps[Annotated[float, Field(ge=0, le=1)]]
"""By name, the value under the layer of each map that the layer paints beside base_color; 0 is a flat `normal`."""


class AssetRef(StrictModel):
    """A file, relative to the folder of the scene or data set, and the hash of its content."""

    path: str
    sha256: str | None = None


class OrbitCamera(StrictModel):
    """A camera on a sphere about `target`; azimuth 0 looks at the nose (from +Z), 90 from +X."""

    azimuth_degrees: float
    elevation_degrees: Annotated[float, Field(ge=-89.9, le=89.9)]
    distance: float = Field(gt=0)
    target: tuple[float, float, float] = (0.0, 0.0, 0.0)
    vertical_fov_degrees: float = Field(default=35.0, gt=0, lt=180)

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

    asset: AssetRef
    rotation_degrees: float = 0.0
    scale: float = Field(default=1.0, gt=0, description="multiplies the file's radiance")


class SceneModel(StrictModel):
    """A trained generator that paints layers, and the conditions that it knows (`Conditions`)."""

    asset: AssetRef
    amounts: tuple[float, float] | None = None
    recipes: tuple[str, ...] = ()

    @property
    def conditions(self) -> Conditions:
        return Conditions(self.amounts, self.recipes)


class SceneWeathering(StrictModel):
    """The layer that the learnable parts carry: painted by a recipe, or by a model that learned it."""

    recipe: str
    amount: float = Field(default=1.0, ge=0, le=1)
    seed: int = 0
    options: dict[str, Any] = {}
    model: SceneModel | None = None


class Scene(StrictModel):
    """The thesis's scene description Phi: what `svbrdfgan render` reads and every exemplar keeps.

    `materials` overrides the base colours of the named parts; parts not named keep the mesh's own. `maps` are those
    that the layer paints beside base_color, with their values on the learnable parts under it. They also decide what is
    rendered of the mesh's file: its values of these maps on other parts, and its alpha if there is any. `weathering` is
    None where there is none, and "unknown" in an imported picture, whose weathering nobody described.
    """

    mesh: AssetRef
    environment: SceneEnvironment
    camera: OrbitCamera
    width: int = Field(ge=1)
    height: int = Field(ge=1)
    spp: int = Field(default=64, ge=1)
    seed: int = 0
    texture: int = Field(default=256, ge=16, multiple_of=4)
    renderer: PluginField = PluginChoice(name="auto")
    embedding: PluginField = PluginChoice(name="hemispherical")
    learnable: PartSelection = PartSelection()
    materials: dict[str, Color] = {}
    maps: MapValues = {}
    weathering: SceneWeathering | Literal["unknown"] | None = None

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
