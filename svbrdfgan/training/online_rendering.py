"""Online rendering: fakes rendered from scratch at every visit, by any renderer, for what cannot be stored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.rendering.render_layer import RenderLayer
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.training.reference_pictures import ReferencePictures
from svbrdfgan.training.scene_batch import Coverage, Images, Layers, prepared_surface, seen_in_gradient, with_progress
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
    prepared: tuple[Any, ...]
    own_camera: bool = False
    own_light: bool = False

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
        return references(self.exemplars, self.indices[n], self.scenes[n], self.layer, self.prepared[n])


@dataclass(frozen=True, eq=False)
class OnlineRendering:
    """Scenes for fakes, rendered from scratch: every visit has its own samples. Prepared surfaces stay in memory."""

    exemplars: Exemplars
    perturbation: Perturbation
    layer: RenderLayer
    _prepared: dict[int, Any] = field(default_factory=dict)

    def build(self, indices: Iterable[int], progress: Callable[[int], None] | None = None) -> None:
        """Prepares the surfaces of these exemplars."""
        for index in with_progress(indices, progress):
            self._surface(index)

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> OnlineSceneBatch:
        """A scene for each of these exemplars; `visit` changes nothing."""
        scenes = tuple(self.perturbation.scene(self.exemplars.scenes[i], i, rng) for i in indices)
        prepared, changed = tuple(self._surface(index) for index in indices), self.perturbation.config
        return OnlineSceneBatch(
            self.layer,
            scenes,
            self.exemplars,
            tuple(indices),
            prepared,
            own_camera=changed.same_camera,
            own_light=changed.environment == "same",
        )

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Does nothing: a picture cannot be rendered before the generator has painted its layer."""

    def gbuffer(self, index: int) -> Float[Tensor, "height width 6"]:
        """Position and normal per pixel of an exemplar's own scene."""
        return self._references(index).gbuffer()

    def light_buffer(self, index: int) -> Float[Tensor, "height width 9"]:
        """How an exemplar's own scene lights reference materials."""
        return self._references(index).light_buffer()

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface; from its gradient."""
        return seen_in_gradient(self.exemplars, index, self.layer.renderer, self._surface(index), self.layer.spp)

    def _references(self, index: int) -> ReferencePictures:
        scene = self.exemplars.scenes[index]
        return references(self.exemplars, index, scene, self.layer, self._surface(index))

    def _surface(self, index: int) -> Any:
        return prepared_surface(self.exemplars, index, self.layer.renderer, self._prepared)


def references(exemplars: Exemplars, index: int, scene: Scene, layer: RenderLayer, prepared: Any) -> ReferencePictures:
    """The reference pictures of a scene of an exemplar's subject, by the renderer and with the samples of its fakes."""
    view = exemplars.loader.view(scene)
    return ReferencePictures(layer.renderer, prepared, exemplars.subject(index), scene, view, layer.spp)
