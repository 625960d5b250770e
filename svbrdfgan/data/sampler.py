"""`ConfigSampler` (thesis A.2): draws scene descriptions from a data set's declared distributions."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from pydantic import Field

from svbrdfgan.config.models import StrictModel
from svbrdfgan.data.config import (
    BRIGHTNESS,
    CLOSE_DISTANCE,
    DISTANCE,
    ELEVATION,
    FIELD_OF_VIEW,
    CameraDistribution,
    DatasetConfig,
    Split,
)
from svbrdfgan.errors import ConfigError
from svbrdfgan.scene.description import AssetRef, OrbitCamera, Scene, SceneEnvironment, SceneModel, SceneWeathering


class MeshAsset(StrictModel):
    """A mesh of the pool: its file, its box, the names of the parts that will be painted, and those of all its parts.

    `views` counts the pictures of it in an imported data set; elsewhere the split does. `viewpoints` are those of
    close-ups, if the split has any: x, y and z of a point in metres, and azimuth and elevation of a camera in degrees.
    """

    name: str
    asset: AssetRef
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]]
    painted: tuple[str, ...]
    parts: tuple[str, ...] = ()
    views: int | None = Field(default=None, ge=1)
    viewpoints: tuple[tuple[float, float, float, float, float], ...] = ()


class EnvironmentAsset(StrictModel):
    """An environment of the pool, and the factor that brings its mean radiance to one."""

    name: str
    asset: AssetRef
    normalisation: float


@dataclass(frozen=True)
class ConfigSampler:
    """Scenes of one split. Scene `index` depends on seed, split and index alone, in whatever order drawn."""

    config: DatasetConfig
    split: Split
    meshes: tuple[MeshAsset, ...]
    environments: tuple[EnvironmentAsset, ...]
    model: SceneModel | None = None

    def __len__(self) -> int:
        return len(self._mesh_of)

    def mesh(self, index: int) -> MeshAsset:
        """The mesh of scene `index`: views of one mesh follow each other."""
        return self._mesh_of[index]

    def scene(self, index: int) -> Scene:
        """The scene of the exemplar of that index."""
        rng = np.random.default_rng([self.config.seed, zlib.crc32(self.split.encode()), index])
        return self.draw(self.mesh(index), rng)

    def draw(self, mesh: MeshAsset, rng: np.random.Generator) -> Scene:
        """A scene of this mesh, drawn by `rng`."""
        config = self.config
        width, height = config.image
        paint = None if config.paint is None else config.paint.sample(rng)
        environment, (camera, window) = self.draw_environment(rng), self._draw_view(mesh, rng, None)
        return Scene(
            mesh=mesh.asset,
            environment=environment,
            camera=camera,
            width=width,
            height=height,
            spp=config.spp,
            seed=int(rng.integers(2**31)),
            texture=config.texture,
            window=window,
            renderer=config.renderer,
            embedding=config.embedding,
            learnable=config.learnable,
            materials={} if paint is None else dict.fromkeys(mesh.painted, paint),
            weathering=self._weathering(rng),
            maps={name: clamped(value.sample(rng), (0.0, 1.0)) for name, value in config.maps.items()},
        )

    def draw_environment(
        self, rng: np.random.Generator, pool: tuple[EnvironmentAsset, ...] | None = None
    ) -> SceneEnvironment:
        """A light: map, rotation and brightness, from the split's pool or another."""
        pool = pool or self.environments
        environment = pool[int(rng.integers(len(pool)))]
        brightness = self.config.environment_brightness.sample(rng)
        return SceneEnvironment(
            asset=environment.asset,
            rotation_degrees=self.config.environment_rotation_degrees.sample(rng),
            scale=clamped(brightness, BRIGHTNESS) * environment.normalisation,
        )

    def draw_camera(
        self, mesh: MeshAsset, rng: np.random.Generator, declared: CameraDistribution | None = None
    ) -> OrbitCamera:
        """A camera from the split's distribution or another: about a point in the mesh's box, or a close-up.

        Raises:
            ConfigError: the other distribution has close-ups, and the split has none.
        """
        return self._draw_view(mesh, rng, declared)[0]

    def _draw_view(
        self, mesh: MeshAsset, rng: np.random.Generator, declared: CameraDistribution | None
    ) -> tuple[OrbitCamera, int | None]:
        """A camera as `draw_camera` draws it, and the size of the window that its picture shows; None: all is shown."""
        declared, (width, height) = declared or self.config.camera_of(self.split), self.config.image
        lower, upper = np.asarray(mesh.bounds)
        fov = clamped(declared.vertical_fov_degrees.sample(rng), FIELD_OF_VIEW)
        fit = fit_distance(float(np.linalg.norm(upper - lower)) / 2, math.radians(fov), width / height)
        if declared.close_ups is not None and rng.random() < declared.close_ups.share:
            if not mesh.viewpoints:
                raise ConfigError(
                    "close_ups are for data sets whose own cameras of this split have some; leave them out."
                )
            x, y, z, azimuth, elevation = mesh.viewpoints[int(rng.integers(len(mesh.viewpoints)))]
            camera = OrbitCamera(
                azimuth_degrees=azimuth,
                elevation_degrees=clamped(elevation, ELEVATION),
                distance=clamped(declared.close_ups.distance.sample(rng), CLOSE_DISTANCE) * fit,
                target=(x, y, z),
                vertical_fov_degrees=fov,
            )
            return camera, declared.close_ups.window
        aside = declared.spread * (rng.random(3) - 0.5) if declared.spread else np.zeros(3)
        x, y, z = ((lower + upper) / 2 + aside * (upper - lower)).tolist()
        camera = OrbitCamera(
            azimuth_degrees=declared.azimuth_degrees.sample(rng) % 360.0,
            elevation_degrees=clamped(declared.elevation_degrees.sample(rng), ELEVATION),
            distance=clamped(declared.distance.sample(rng), DISTANCE) * fit,
            target=(x, y, z),
            vertical_fov_degrees=fov,
        )
        return camera, None

    @cached_property
    def _mesh_of(self) -> tuple[MeshAsset, ...]:
        views = self.config.splits[self.split].views
        return tuple(mesh for mesh in self.meshes for _ in range(mesh.views or views))

    def _weathering(self, rng: np.random.Generator) -> SceneWeathering | Literal["unknown"]:
        declared = self.config.weathering
        if declared is None:
            return "unknown"
        return SceneWeathering(
            recipe=declared.recipe.sample(rng),
            amount=clamped(declared.amount.sample(rng), (0.0, 1.0)),
            seed=declared.seed.sample(rng),
            options=declared.options,
            model=self.model,
        )


def clamped(value: float, limits: tuple[float, float]) -> float:
    """The value, or the nearer limit: what `normal` draws has no bounds of its own."""
    return min(max(value, limits[0]), limits[1])


def fit_distance(radius: float, vertical_fov: float, aspect: float) -> float:
    """The distance from which a sphere just fits the narrower side of the picture."""
    narrow = min(math.tan(vertical_fov / 2), aspect * math.tan(vertical_fov / 2))
    return radius / math.sin(math.atan(narrow))
