"""The manifest of pictures to import: their meshes and cameras. `docs/configuration.md` lists every key."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from svbrdfgan.config.models import StrictModel, validate
from svbrdfgan.data.config import DatasetConfig, MeshSource, SharedConfig, Split, SplitConfig
from svbrdfgan.data.photos.alignment import Alignment
from svbrdfgan.data.photos.calibrated_camera import CalibratedCamera
from svbrdfgan.scene.description import OrbitCamera
from svbrdfgan.types import Camera

_LEVEL = 0.1
"""Horizontal part of a direction below which it counts as vertical."""

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Reflectance = tuple[Share, Share, Share]
"""Linear RGB."""


class LookAtCamera(StrictModel):
    """A level camera by its position and the point in the middle of its picture, in metres of the mesh."""

    position: tuple[float, float, float] = Field(description="where the camera stands")
    look_at: tuple[float, float, float] = Field(description="the point in the middle of the picture")
    vertical_fov_degrees: float = Field(
        default=35.0, gt=0, lt=180, description="full angle over the height of the whole picture"
    )

    def camera(self) -> Camera:
        return Camera(self.position, self.look_at, vertical_fov=math.radians(self.vertical_fov_degrees))


def _kind(value: Any) -> str:
    """The tag of the intended camera, so that errors are reported for that one alone."""
    keys = set(value) if isinstance(value, dict) else getattr(type(value), "model_fields", {}).keys()
    if "camera_to_world" in keys:
        return "calibrated"
    return "look-at" if {"position", "look_at"} & keys else "orbit"


PictureCamera = Annotated[
    Annotated[OrbitCamera, Tag("orbit")]
    | Annotated[LookAtCamera, Tag("look-at")]
    | Annotated[CalibratedCamera, Tag("calibrated")],
    Discriminator(_kind),
]


class SharedLight(StrictModel):
    """Which pictures show the same light."""

    light_group: str | None = Field(
        default=None,
        description="a name of your choice: pictures with the same one were taken in one light, which is estimated "
        "from all of them together",
    )
    turntable: bool = Field(
        default=False,
        description="whether the object was turned between the group's pictures, while camera and light stood still",
    )

    @model_validator(mode="after")
    def _turns_in_a_light(self) -> SharedLight:
        if self.turntable and self.light_group is None:
            raise ValueError("turntable says how a 'light_group' was taken, and none is named")
        return self


class PictureEntry(SharedLight):
    """A picture. Files are relative to the manifest."""

    file: str = Field(description="the picture: PNG, JPEG or EXR")
    mesh: str = Field(description="the mesh's file")
    camera: PictureCamera = Field(
        description="by angles and distance from a target, by `position` and `look_at`, or by `camera_to_world`"
    )
    mask: str | None = Field(default=None, description="an image of the same size, white where the object is")
    paint: Reflectance | None = Field(
        default=None,
        description="linear base colour of the learnable parts in this picture; `null`: that of the manifest's `paint`",
    )
    before: str | None = Field(
        default=None,
        description="the same picture of the clean object: same tripod, light, exposure and white balance; its shading "
        "is then known",
    )
    without_flash: str | None = Field(
        default=None,
        description="the same picture without the flash that lights `file` from beside the lens; their difference is "
        "used, so that both must be linear EXR files to be exact",
    )
    flash: tuple[Positive, Positive, Positive] | None = Field(
        default=None,
        description="how bright the flash makes white paper at 1 in the mesh's unit, linear, each channel; `null`: "
        "estimated for each picture",
    )
    environment: str | None = Field(default=None, description="the light, where it is known")
    environment_rotation_degrees: float = Field(default=0.0, description="its turn about the vertical")

    @model_validator(mode="after")
    def _turns_something(self) -> PictureEntry:
        if self.environment is None and self.environment_rotation_degrees:
            raise ValueError("environment_rotation_degrees turns the light that 'environment' names, and none is named")
        if self.environment is not None and self.light_group is not None:
            raise ValueError("light_group is for light that is estimated, and 'environment' names a known one")
        return self

    @model_validator(mode="after")
    def _is_one_pair(self) -> PictureEntry:
        if self.flash is not None and self.without_flash is None:
            raise ValueError("flash says how bright the flash of 'without_flash' is, and none is named")
        if self.without_flash is None:
            return self
        others = {"before": self.before, "environment": self.environment, "light_group": self.light_group}
        if more := [name for name, value in others.items() if value is not None]:
            raise ValueError(f"without_flash leaves the light of the flash alone: leave out {more[0]!r}")
        return self

    @property
    def second(self) -> str | None:
        """The other picture of the same place, if there is one."""
        return self.before or self.without_flash

    @property
    def heading(self) -> float:
        """The direction from which the camera looks, about the vertical, radians: 0 is +Z, 90 degrees +X."""
        camera = self.camera
        basis = camera.basis() if isinstance(camera, CalibratedCamera) else camera.camera().basis()
        _, top, backward = basis
        # the top of a picture from straight above or below points away from the camera, or towards it
        x, _, z = backward if math.hypot(backward[0], backward[2]) > _LEVEL else -math.copysign(1, backward[1]) * top
        return math.atan2(x, z)


class Capture(SharedLight):
    """Pictures of one object whose cameras another program has found. Paths are relative to the manifest."""

    cameras: str = Field(description="a folder with a COLMAP model, such as `sparse/0`, or NeRF's `transforms.json`")
    images: str | None = Field(
        default=None,
        description="the folder that the pictures' names there are relative to; `null`: that of `transforms.json`",
    )
    masks: str | None = Field(
        default=None,
        description="a folder with a mask for each picture: the picture's name, its suffix replaced or followed by "
        "`.png`; `null`: the masks that `transforms.json` names, if any",
    )
    mesh: str = Field(description="the mesh's file")
    alignment: Alignment = Field(
        default=Alignment(), description="from the axes of `cameras` to the data set's: Y up, nose at +Z, metres"
    )
    align_mesh: bool = Field(
        default=False, description="whether the mesh lies in the axes of `cameras`, too, and is aligned with them"
    )


class Manifest(SharedConfig):
    """The pictures to import, and the data set made of them."""

    pictures: tuple[PictureEntry, ...] = Field(default=(), description="the pictures, one by one")
    captures: tuple[Capture, ...] = Field(
        default=(), description="pictures whose cameras are in a file of COLMAP or a NeRF; they follow `pictures`"
    )
    test: tuple[str, ...] = Field(
        default=(), description="meshes whose pictures are kept from training, as split `test`"
    )
    paint: dict[str, Reflectance] = Field(
        default={},
        description="by mesh, the linear base colour of its learnable parts; others keep the mesh's own material",
    )
    light: Literal["estimated", "mean"] = Field(
        default="estimated",
        description="the light of pictures that name no `environment`: `estimated` for each, or `mean`, that of the "
        "pool `environments`",
    )
    refine_cameras: bool = Field(
        default=False,
        description="whether cameras are changed until the mesh's outline lies on the mask's, in pictures with a mask "
        "whose camera is not a calibrated one",
    )
    camera_error_degrees: float = Field(
        default=1.0,
        ge=0,
        le=30,
        description="how far cameras given by angles or by `position` and `look_at` may be off in azimuth and "
        "elevation, and in distance by as many percent",
    )
    model: str | None = Field(
        default=None,
        description="the folder of a run that learned from these pictures, relative to this file, or the name of a "
        "shipped model: light is estimated as if the pictures showed what it paints on average, instead of by "
        "`weathering_color`",
    )
    bootstrap: int = Field(
        default=8,
        ge=0,
        description="pictures that are simulated after each one and imported likewise; fakes get the errors of these "
        "imports, else the discriminator would know fakes by having none; 0: none",
    )
    weathering_color: Reflectance = Field(
        default=(0.18, 0.18, 0.18),
        description="rough linear colour of the weathering; it helps to separate light from weathering",
    )

    @model_validator(mode="after")
    def _fits_together(self) -> Manifest:
        shown = self.mesh_files
        for key, named in (("paint", self.paint), ("test", self.test)):
            strange = [mesh for mesh in named if mesh not in shown]
            if strange:
                raise ValueError(f"{key} names {strange[0]!r}, which no picture shows; known are {', '.join(shown)}")
        if not self.meshes("train"):
            raise ValueError(
                "there is no picture to train on: name some in 'pictures' or 'captures', and not every mesh in 'test'"
            )
        groups: dict[str, set[bool]] = {}
        for one in (*self.pictures, *self.captures):
            if one.light_group is not None:
                groups.setdefault(one.light_group, set()).add(one.turntable)
        if groups and self.light == "mean":
            raise ValueError("light_group is for light that is estimated, and 'light' is mean")
        mixed = [name for name, turned in groups.items() if len(turned) > 1]
        if mixed:
            raise ValueError(f"turntable is true in some pictures of light_group {mixed[0]!r} and false in others")
        for mesh in shown:
            if len({(c.alignment if c.align_mesh else None) for c in self.captures if c.mesh == mesh}) > 1:
                raise ValueError(f"captures align {mesh!r} in different ways; make a copy of the file for each")
        return self

    @property
    def mesh_files(self) -> tuple[str, ...]:
        """The files of all meshes, in the order in which pictures and captures first name them."""
        named = [entry.mesh for entry in self.pictures] + [capture.mesh for capture in self.captures]
        return tuple(dict.fromkeys(named))

    def keeping(self, numbers: Collection[int]) -> Manifest:
        """The manifest with these of its `pictures` alone; captures must be among them."""
        kept = tuple(entry for number, entry in enumerate(self.pictures) if number in numbers)
        return self.model_copy(update={"pictures": kept, "captures": ()})

    def mesh_alignment(self, mesh: str) -> Alignment:
        """What moves a mesh from the axes of its file to the data set's."""
        return next((c.alignment for c in self.captures if c.mesh == mesh and c.align_mesh), Alignment())

    def meshes(self, split: Split) -> tuple[str, ...]:
        """The mesh files of a split, in the order of `mesh_files`."""
        return tuple(mesh for mesh in self.mesh_files if self.split(mesh) == split)

    def split(self, mesh: str) -> Split:
        return "test" if mesh in self.test else "train"

    def base_paint(self, entry: PictureEntry) -> Reflectance | None:
        """The paint of the learnable parts in this picture; None if they keep the mesh's own material."""
        return entry.paint or self.paint.get(entry.mesh)

    def config(self) -> DatasetConfig:
        """The configuration that `dataset.json` stores; it has no weathering recipe, which is unknown."""
        splits: tuple[Split, ...] = ("train", "test")
        shared = {name: getattr(self, name) for name in SharedConfig.model_fields}
        shared |= {"paint": None, "weathering": None}
        sources = {split: MeshSource(files=self.meshes(split)) for split in splits if self.meshes(split)}
        return DatasetConfig(**shared, splits={split: SplitConfig(meshes=source) for split, source in sources.items()})


def read_manifest(data: dict[str, Any], source: str) -> Manifest:
    """The validated manifest; `source` opens every error message.

    Raises:
        ConfigError: one line for each error.
    """
    return validate(Manifest, data, source)
