"""Stages that render anew at every visit, by any renderer: for what is not linear, or not stored."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.scene import Scene
from svbrdfgan.render_layer import RenderLayer
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.training.stages import Images, Layers, outermost


@dataclass(frozen=True, eq=False)
class FreshStage:
    """Scenes rendered anew each time, by any renderer, for what is not linear or not stored."""

    layer: RenderLayer[Any]
    scenes: tuple[Scene, ...]
    exemplars: Exemplars
    indices: tuple[int, ...]
    prepared: tuple[Any, ...]
    coverage: Float[Tensor, "batch height width"]
    guide: None = None

    def render(self, layers: Layers) -> Images:
        images = [self._render(n, layer).image for n, layer in enumerate(layers)]
        return torch.stack(images).to(layers.device)

    def _render(self, n: int, layer: Float[Tensor, "rows cols channels"]) -> Any:
        subject, scene = self.exemplars.subject(self.indices[n]), self.scenes[n]
        materials = subject.materials(scene.materials, layer.float(), scene.maps)
        return self.layer(self.prepared[n], materials, self.exemplars.studio.view(scene), seed=scene.seed)


@dataclass(frozen=True, eq=False)
class FreshRenders:
    """Stages that render anew: every visit has its own samples. Surfaces stay prepared in memory."""

    exemplars: Exemplars
    perturbation: Perturbation
    layer: RenderLayer[Any]
    device: torch.device
    _prepared: dict[int, Any] = field(default_factory=dict)

    def build(self, indices: Iterable[int], progress: Callable[[int], None] | None = None) -> None:
        """Prepares the surfaces of these exemplars."""
        for index in indices:
            self._surface(index)
            if progress is not None:
                progress(1)

    def stage(self, indices: Sequence[int], rng: np.random.Generator) -> FreshStage:
        """A scene for each of these exemplars, its coverage that of the exemplar's own picture."""
        scenes = tuple(self.perturbation.scene(self.exemplars.scenes[i], i, rng) for i in indices)
        prepared = tuple(self._surface(index) for index in indices)
        coverage = torch.stack(
            [self._coverage(i, scene, p) for i, scene, p in zip(indices, scenes, prepared, strict=True)]
        )
        return FreshStage(self.layer, scenes, self.exemplars, tuple(indices), prepared, coverage.to(self.device))

    def expect(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Does nothing: pictures cannot be had ahead of their layers."""

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Where an exemplar's picture shows the outermost learnable surface: where its gradient is not zero."""
        scene, subject = self.exemplars.scenes[index], self.exemplars.subject(index)
        white = torch.full((*subject.buffer.part.shape, 4), 0.5)
        view = self.exemplars.studio.view(scene)
        gradients = self.layer.renderer.render_vjp(
            self._surface(index),
            subject.materials(scene.materials, white),
            view,
            torch.ones(view.height, view.width, 3),
            wrt=frozenset({"base_color"}),
            spp=self.layer.spp,
            seed=scene.seed,
        )
        seen = [gradients.materials[part]["base_color"].abs().sum(dim=-1).cpu() for part in subject.learnable]
        return outermost(self.exemplars, index, torch.stack(seen))

    def _coverage(self, index: int, scene: Scene, prepared: Any) -> Float[Tensor, "height width"]:
        """One cheap render: the layer changes no coverage."""
        materials = self.exemplars.subject(index).materials(scene.materials, None)
        view = self.exemplars.studio.view(scene)
        return self.layer.renderer.render(prepared, materials, view, spp=self.layer.spp, seed=scene.seed).coverage

    def _surface(self, index: int) -> Any:
        number = int(self.exemplars.subject_of[index])
        if number not in self._prepared:
            self._prepared[number] = self.layer.renderer.prepare(self.exemplars.subjects[number].surface)
        return self._prepared[number]
