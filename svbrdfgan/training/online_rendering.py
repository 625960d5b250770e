"""Online rendering: fakes rendered from scratch at every visit, by any renderer, for what cannot be stored."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.rendering.checked_renderer import PreparedSurface
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.training.reference_pictures import ReferencePictures
from svbrdfgan.training.scene_batch import (
    Coverage,
    Images,
    Layers,
    PreparedSurfaces,
    Progress,
    seen_in_gradient,
    with_progress,
)
from svbrdfgan.types import Layer, Rendering


@dataclass(frozen=True, eq=False)
class OnlineSceneBatch:
    """A batch of scenes that a renderer traces when a layer is rendered, and buffers when they are first asked for.

    Attributes:
        own_camera, own_light: whether these are those of the exemplars' scenes.
    """

    layer: RenderLayer
    scenes: tuple[Scene, ...]
    exemplars: Exemplars
    indices: tuple[int, ...]
    prepared: tuple[PreparedSurface, ...]
    own_camera: bool = False
    own_light: bool = False
    demodulator: None = None
    """A picture alone does not say which texels its pixels show."""

    @cached_property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"] | None:
        if self.own_camera:
            return None
        return torch.stack([self._references(n).gbuffer() for n in range(len(self.scenes))])

    @cached_property
    def light_buffer(self) -> Float[Tensor, "batch height width 9"] | None:
        if self.own_camera and self.own_light:
            return None
        return torch.stack([self._references(n).light_buffer() for n in range(len(self.scenes))])

    @cached_property
    def clean(self) -> Float[Tensor, "batch height width 3"] | None:
        if self.own_camera and self.own_light:
            return None
        return torch.stack([self._references(n).clean() for n in range(len(self.scenes))])

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        renderings = [self._render(n, layer) for n, layer in enumerate(layers)]
        images = torch.stack([rendering.image for rendering in renderings])
        coverage = torch.stack([rendering.coverage for rendering in renderings])
        return images.to(layers.device), coverage.to(layers.device)

    def _render(self, n: int, layer: Float[Tensor, "rows cols channels"]) -> Rendering:
        subject, scene = self.exemplars.subject(self.indices[n]), self.scenes[n]
        painted = Layer(layer.float(), tuple(scene.maps))
        materials = subject.materials(painted, scene.maps, base_colors=scene.materials)
        return self.layer(self.prepared[n], materials, self.exemplars.loader.view(scene), seed=scene.seed)

    def _references(self, n: int) -> ReferencePictures:
        """The reference pictures of a scene, by the renderer and with the samples of its fake."""
        subject, view = self.exemplars.subject(self.indices[n]), self.exemplars.loader.view(self.scenes[n])
        return ReferencePictures(self.layer.renderer, self.prepared[n], subject, self.scenes[n], view, self.layer.spp)


@dataclass(eq=False)
class OnlineRendering:
    """Scenes for fakes, rendered from scratch: every visit has its own samples.

    Prepared surfaces stay in memory; of windows, the last ones.
    """

    exemplars: Exemplars
    perturbation: Perturbation
    layer: RenderLayer

    def __post_init__(self) -> None:
        self._surfaces = PreparedSurfaces(self.exemplars, self.layer.renderer)

    def build(self, indices: Iterable[int], progress: Progress | None = None) -> None:
        """Prepares the surfaces of these exemplars."""
        for index in with_progress(indices, progress):
            self._surfaces.of(index)

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> OnlineSceneBatch:
        """A scene for each of these exemplars; `visit` changes nothing."""
        changed = self.perturbation.config
        scenes = [self.perturbation.scene(self.exemplars.scenes[index], index, rng) for index in indices]
        return self._batch(indices, scenes, changed.same_camera, changed.environment == "same")

    def first_scenes(self, indices: Sequence[int]) -> OnlineSceneBatch:
        """The own scenes of these exemplars."""
        return self._batch(indices, [self.exemplars.scenes[index] for index in indices])

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Does nothing: a picture cannot be rendered before the generator has painted its layer."""

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface; from its gradient."""
        return seen_in_gradient(self.exemplars, index, self.layer.renderer, self._surfaces.of(index), self.layer.spp)

    def own_scenes(self, spp: int, *, keep: bool) -> OnlineRendering:
        """The same scenes: nothing of the exemplars' own is stored."""
        return self

    def seen_in(self, config: ScenesConfig) -> None:
        """None: what is seen is known of the exemplars' own pictures alone."""

    def resampled(self, spp: int) -> OnlineRendering:
        """The same scenes with another number of samples per pixel."""
        return replace(self, layer=replace(self.layer, spp=spp))

    def _batch(
        self, indices: Sequence[int], scenes: Sequence[Scene], own_camera: bool = False, own_light: bool = False
    ) -> OnlineSceneBatch:
        surfaces = tuple(self._surfaces.of(index) for index in indices)
        return OnlineSceneBatch(
            self.layer, tuple(scenes), self.exemplars, tuple(indices), surfaces, own_camera, own_light
        )
