"""The scenes that fakes are rendered in: an exemplar's own, or a perturbation of it (thesis 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from svbrdfgan.data.sampler import ConfigSampler, EnvironmentAsset
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import ScenesConfig


@dataclass(frozen=True)
class Perturbation:
    """Draws the scene of a fake from the scene of an exemplar.

    Attributes:
        config: what to change.
        sampler: the data set's distributions, from which lights and cameras are drawn.
        environments: the pool of lights to draw from, if not the split's own.
    """

    config: ScenesConfig
    sampler: ConfigSampler
    environments: tuple[EnvironmentAsset, ...] | None = None

    def scene(self, exemplar: Scene, index: int, rng: np.random.Generator) -> Scene:
        """A scene like the exemplar's with another seed, so that its noise is not the exemplar's."""
        camera, environment = exemplar.camera, exemplar.environment
        if self.config.camera is not None:
            camera = self.sampler.draw_camera(self.sampler.mesh(index), rng, self.config.camera)
        if self.config.camera_noise_degrees > 0:
            noise = rng.uniform(-1, 1, size=2) * self.config.camera_noise_degrees
            camera = camera.model_copy(
                update={
                    "azimuth_degrees": (camera.azimuth_degrees + float(noise[0])) % 360.0,
                    "elevation_degrees": float(np.clip(camera.elevation_degrees + noise[1], -89.0, 89.0)),
                }
            )
        if self.config.environment != "same":
            environment = self.sampler.draw_environment(rng, self.environments)
        seed = int(rng.integers(2**31))
        return exemplar.model_copy(update={"camera": camera, "environment": environment, "seed": seed})
