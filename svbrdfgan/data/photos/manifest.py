"""The manifest of pictures to import: their meshes and cameras. `docs/own-pictures.md` explains every key."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from svbrdfgan.config.choices import PartSelection, PluginChoice, PluginField
from svbrdfgan.config.distributions import Fixed, Number, Uniform
from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.config import DatasetConfig, EnvironmentSource, MeshSource, ProceduralSkies, Split, SplitConfig
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Camera

Share = Annotated[float, Field(ge=0, le=1)]
Reflectance = tuple[Share, Share, Share]
"""Linear RGB."""


class LookAtCamera(StrictModel):
    """A level camera by its position and the point in the middle of its picture, in metres of the mesh."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    vertical_fov_degrees: float = Field(default=35.0, gt=0, lt=180)

    def camera(self) -> Camera:
        return Camera(self.position, self.look_at, vertical_fov=math.radians(self.vertical_fov_degrees))


def _kind(value: Any) -> str:
    """The tag of the intended camera, so that errors are reported for that one alone."""
    by_position = {"position", "look_at"} & set(value) if isinstance(value, dict) else isinstance(value, LookAtCamera)
    return "look-at" if by_position else "orbit"


PictureCamera = Annotated[
    Annotated[OrbitCamera, Tag("orbit")] | Annotated[LookAtCamera, Tag("look-at")], Discriminator(_kind)
]


class PictureEntry(StrictModel):
    """One picture. Files are relative to the manifest."""

    file: str
    mesh: str
    camera: PictureCamera
    mask: str | None = None
    paint: Reflectance | None = None
    environment: str | None = None
    environment_rotation_degrees: float = 0.0

    @model_validator(mode="after")
    def _turns_something(self) -> PictureEntry:
        if self.environment is None and self.environment_rotation_degrees:
            raise ValueError("environment_rotation_degrees turns the light that 'environment' names, and none is named")
        return self


class Manifest(StrictModel):
    """The pictures, and the data set made of them. Keys that `DatasetConfig` has too have the same meaning."""

    pictures: tuple[PictureEntry, ...]
    test: tuple[str, ...] = Field(default=(), description="meshes whose pictures are kept from training")
    paint: dict[str, Reflectance] = Field(default={}, description="by mesh, of its learnable parts")
    light: Literal["estimated", "mean"] = Field(default="estimated", description="where a picture names none")
    weathering_color: Reflectance = Field(
        default=(0.18, 0.18, 0.18), description="approximate; separates light from weathering"
    )
    image: tuple[Annotated[int, Field(ge=8, le=8192)], Annotated[int, Field(ge=8, le=8192)]] = (256, 256)
    texture: int = Field(default=256, ge=16, le=4096, multiple_of=4)
    renderer: PluginField = PluginChoice(name="auto")
    embedding: PluginField = PluginChoice(name="hemispherical")
    learnable: PartSelection = PartSelection()
    environments: EnvironmentSource = EnvironmentSource(procedural=ProceduralSkies(count=8))
    environment_rotation_degrees: Number = Uniform(uniform=(0.0, 360.0))
    environment_rows: int = Field(default=256, ge=8)
    environment_brightness: Number = Fixed[float](fixed=1.0)

    @model_validator(mode="after")
    def _fits_together(self) -> Manifest:
        shown = {entry.mesh for entry in self.pictures}
        for key, named in (("paint", self.paint), ("test", self.test)):
            strange = [mesh for mesh in named if mesh not in shown]
            if strange:
                raise ValueError(f"{key} names {strange[0]!r}, which no picture shows; known are {', '.join(shown)}")
        if not self.meshes("train"):
            raise ValueError("there is no picture to train on: name some in 'pictures', and not every mesh in 'test'")
        return self

    def meshes(self, split: Split) -> tuple[str, ...]:
        """The mesh files of a split, in the order in which pictures first name them."""
        named = dict.fromkeys(entry.mesh for entry in self.pictures)
        return tuple(mesh for mesh in named if self.split(mesh) == split)

    def split(self, mesh: str) -> Split:
        return "test" if mesh in self.test else "train"

    def base_paint(self, entry: PictureEntry) -> Reflectance | None:
        """The paint of the learnable parts in this picture; None if they keep the mesh's own material."""
        return entry.paint or self.paint.get(entry.mesh)

    def config(self) -> DatasetConfig:
        """The configuration that `dataset.json` stores; it has no weathering recipe, which is unknown."""
        splits: tuple[Split, ...] = ("train", "test")
        shared = {name: getattr(self, name) for name in Manifest.model_fields if name in DatasetConfig.model_fields}
        shared |= {"paint": None, "weathering": None}
        sources = {split: MeshSource(files=self.meshes(split)) for split in splits if self.meshes(split)}
        return DatasetConfig(**shared, splits={split: SplitConfig(meshes=source) for split, source in sources.items()})


def read_manifest(data: dict[str, Any], source: str) -> Manifest:
    """The validated manifest; `source` opens every error message.

    Raises:
        ConfigError: one line for each error.
    """
    return validate(Manifest, data, source)
