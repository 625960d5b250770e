"""Relit FLIP: pictures of what was learned, under lights and from views that training never had."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import EnvironmentSource, ProceduralSkies
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.gather import gather_environments, match_files
from svbrdfgan.data.index import DatasetIndex
from svbrdfgan.data.sampler import ConfigSampler, EnvironmentAsset
from svbrdfgan.errors import ConfigError
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.io.environment import load_environment
from svbrdfgan.metrics.flip import display, flip
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.scene.subject import Subject
from svbrdfgan.scene.window import bordered
from svbrdfgan.types import Layer, View
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.leftovers import scratch_folder

_SEED = 7919
"""Seed of the scenes and of the procedural lights: far from the seeds that data sets use."""
_LIGHTS = 4  # skies, and as many rooms
_KEPT = 4  # scenes whose pictures are kept, at most


@dataclass(frozen=True)
class Relight:
    """The choice of scenes that a run is relit in.

    Attributes:
        files: shell patterns of environment maps that training never used; none stands for procedural skies and rooms.
        scenes: scenes of each subject.
    """

    files: tuple[str, ...] = ()
    scenes: int = 2


@dataclass(frozen=True, eq=False)
class PaintedScene:
    """Display-referred pictures of one scene.

    Attributes:
        reference: under the true layer, with random numbers of its own.
        pictures: under each painter's layer.
    """

    scene: Scene
    coverage: Float[Tensor, "height width"]
    reference: Float[Tensor, "height width 3"]
    pictures: dict[Painter, Float[Tensor, "height width 3"]]

    def flips(self) -> dict[Painter, float]:
        """FLIP between the reference and each other picture."""
        return {painter: flip(self.reference, picture) for painter, picture in self.pictures.items()}


@dataclass(frozen=True, eq=False)
class Setting:
    """A scene in which layers of one subject are rendered.

    Attributes:
        view: that of the scene, or another.
        prepared: the subject's surface, as the renderer prepared it.
    """

    scene: Scene
    view: View
    subject: Subject
    renderer: CheckedRenderer
    prepared: Any

    def picture(self, layer: Layer, seed: int) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width"]]:
        """A display-referred picture under a layer, and its coverage, on the CPU; equal seeds share random numbers."""
        if self.scene.window is not None:
            layer = replace(layer, values=bordered(layer.values))
        materials = self.subject.materials(layer, self.scene.maps, base_colors=self.scene.materials)
        rendering = self.renderer.render(self.prepared, materials, self.view, spp=self.scene.spp, seed=seed)
        coverage = rendering.coverage.cpu()
        return display(rendering.image.cpu(), coverage=coverage), coverage

    def painted(self, layers: Mapping[Painter, Layer]) -> PaintedScene:
        """Pictures under each layer, which share random numbers; the reference has others.

        Args:
            layers: the true one is among them.
        """
        reference, _ = self.picture(layers["truth"], self.scene.seed)
        shown = {painter: self.picture(layer, (self.scene.seed + 1) % 2**31) for painter, layer in layers.items()}
        pictures = {painter: picture for painter, (picture, _) in shown.items()}
        return PaintedScene(self.scene, shown["truth"][1], reference, pictures)


@dataclass(frozen=True, eq=False)
class Relit:
    """Mean FLIP of each painter's layers, and the scenes of a few subjects."""

    flips: dict[Painter, float]
    scenes: tuple[PaintedScene, ...]


@dataclass(frozen=True, eq=False)
class Relighter:
    """Relights a run in scenes that follow from a data set and a configuration alone.

    Attributes:
        pool: the lights.
        loader: holds their radiance.
        count: scenes of each subject.
    """

    pool: tuple[EnvironmentAsset, ...]
    loader: SceneLoader
    count: int

    @classmethod
    def make(cls, config: Relight, index: DatasetIndex) -> Relighter:
        """Reads or makes the lights.

        Raises:
            ConfigError: a pattern matches nothing, or a light is one that training used.
            AssetError: a file cannot be read.
        """
        with scratch_folder() as folder:
            pool = _lights(config.files, index, folder)
            radiance = {light.asset.path: load_environment(folder / light.asset.path) for light in pool}
        return cls(pool, SceneLoader(Path(), keep=False, _lights=radiance), config.scenes)

    def relit(
        self,
        exemplars: Exemplars,
        sampler: ConfigSampler,
        renderer: CheckedRenderer,
        layers_of: Callable[[int], Mapping[Painter, Layer]],
        display: Display,
    ) -> Relit:
        """Renders the layers of all weathered subjects in new scenes, and compares them with G0's.

        Cameras come from the split's distribution, rotations and brightness from the data set's. There are as many
        samples as in the exemplars.

        Args:
            layers_of: an exemplar's layers, the true one among them.
        """
        totals, kept = defaultdict[Painter, float](float), []
        subjects = range(len(exemplars.subjects))
        scenes = [found for n in subjects for found in self.scenes_of(n, exemplars, sampler, self.count)]
        display.begin("comparing relit pictures", len(scenes))
        spread = evenly(len(scenes), _KEPT)
        prepared: dict[int, Any] = {}
        for number, (exemplar, scene) in enumerate(scenes):
            subject = int(exemplars.subject_of[exemplar])
            if subject not in prepared:  # scenes of a subject follow each other
                prepared = {subject: renderer.prepare(exemplars.subjects[subject].surface)}
            view, shown = self.loader.view(scene), exemplars.subjects[subject]
            found = Setting(scene, view, shown, renderer, prepared[subject]).painted(layers_of(exemplar))
            for name, value in found.flips().items():
                totals[name] += value / len(scenes)
            kept += [found] if number in spread else []
            display.advance()
        return Relit(dict(totals), tuple(kept))

    def scenes_of(
        self, subject: int, exemplars: Exemplars, sampler: ConfigSampler, count: int
    ) -> Iterator[tuple[int, Scene]]:
        """Yields weathered exemplars of a subject in turn, and each one's scene with another camera, light and seed.

        Scenes of windows keep their cameras, since other ones would see other windows.
        """
        weathered = list(filter(exemplars.weathered, exemplars.views_of(subject)))
        for number in range(count if weathered else 0):
            exemplar, rng = weathered[number % len(weathered)], np.random.default_rng([_SEED, subject, number])
            scene, camera = exemplars.scenes[exemplar], sampler.draw_camera(sampler.mesh(exemplar), rng)
            new = {
                "camera": camera if scene.window is None else scene.camera,
                "environment": sampler.draw_environment(rng, self.pool),
                "seed": int(rng.integers(2**31)),
            }
            yield exemplar, scene.model_copy(update=new)


def evenly(count: int, at_most: int) -> list[int]:
    """Indices of up to so many of `count` things, evenly spread from the first to the last."""
    return sorted({round(n) for n in np.linspace(0, count - 1, min(at_most, count))})


def _lights(files: Sequence[str], index: DatasetIndex, folder: Path) -> tuple[EnvironmentAsset, ...]:
    """The pool of lights, stored in a folder."""
    rows = index.config.environment_rows
    if not files:
        kinds = (ProceduralSkies(count=_LIGHTS, kind=kind, seed=_SEED) for kind in ("outdoor", "indoor"))
        pools = [gather_environments(EnvironmentSource(procedural=kind), [], rows, folder) for kind in kinds]
        return tuple(light for pool in pools for light in pool)
    pool = gather_environments(EnvironmentSource(files=tuple(files)), match_files(files, Path()), rows, folder)
    trained = {light.asset.sha256 for light in index.environments["train"]}
    if known := [light.name for light in pool if light.asset.sha256 in trained]:
        raise ConfigError(f"training used {', '.join(known)}: name other environment maps to relight with.")
    return pool
