"""Where fakes are rendered: batches of scenes, ready to show any layers, by stored transport or by fresh rendering."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.compositing import composite
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.scene import Scene
from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Renderer, TransportRenderer
from svbrdfgan.render_layer import RenderLayer
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.transport import LightTransport, TransportBatch, build_transport

Layers = Float[Tensor, "batch rows cols channels"]
Images = Float[Tensor, "batch height width 3"]

log = logging.getLogger(__name__)


class Stage(Protocol):
    """A batch of scenes. `guide` is position and normal as seen, premultiplied; None if the renderer cannot tell."""

    @property
    def coverage(self) -> Float[Tensor, "batch height width"]: ...

    @property
    def guide(self) -> Float[Tensor, "batch height width 6"] | None: ...

    def render(self, layers: Layers) -> Images:
        """The pictures of these layers on the learnable parts, differentiable in the layers."""
        ...


@dataclass(frozen=True, eq=False)
class TransportStage:
    """Scenes by their stored transports.

    Attributes:
        batch: the transports.
        base: the reflectance beneath the layer, of each texture of the batch.
    """

    batch: TransportBatch
    base: Float[Tensor, "textures *#size 3"]

    @property
    def coverage(self) -> Float[Tensor, "batch height width"]:
        return self.batch.coverage

    @property
    def guide(self) -> Float[Tensor, "batch height width 6"]:
        return self.batch.guide

    def render(self, layers: Layers) -> Images:
        return self.batch.render(composite(self.base, layers.float()[self.batch.owner]))


@dataclass(frozen=True, eq=False)
class Transports:
    """Stages of stored transports: each scene is traced once, kept in the data set's cache, and held in memory.

    Attributes:
        exemplars: whose scenes to perturb.
        perturbation: how.
        renderer: traces them.
        spp: samples per pixel.
        pool: scenes kept for each exemplar; 0 draws and traces a new one at every visit.
        device: where transports are held.
        seed: of the perturbations.
    """

    exemplars: Exemplars
    perturbation: Perturbation
    renderer: Renderer[Any]
    spp: int
    pool: int
    device: torch.device
    seed: int = 0
    _held: dict[tuple[int, int], LightTransport] = field(default_factory=dict)
    _prepared: dict[int, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.renderer, TransportRenderer) or not self.renderer.capabilities.transport:
            raise ConfigError(
                f"rendering: transport needs a renderer that declares it; {type(self.renderer).__name__} does not: "
                "set rendering: fresh or choose another renderer."
            )

    def build(self, indices: Iterable[int], progress: Callable[[int], None] | None = None) -> None:
        """Traces, or reads, all stored scenes of these exemplars."""
        for index in indices:
            for variant in range(self.pool):
                self._stored(index, variant)
            if progress is not None:
                progress(1)

    def stage(self, indices: Sequence[int], rng: np.random.Generator) -> TransportStage:
        """A scene for each of these exemplars; `rng` chooses among the pool, or draws the scene."""
        if self.pool:
            transports = [self._stored(index, int(rng.integers(self.pool))) for index in indices]
        else:
            transports = [self._trace(index, self._scene(index, rng)) for index in indices]
        return TransportStage(TransportBatch.stack(transports), self._base(indices, transports))

    def guide(self, index: int) -> Float[Tensor, "height width 6"]:
        """Position and normal as seen in the first scene kept for an exemplar."""
        return self._stored(index, 0).guide

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Where an exemplar's picture shows the outermost learnable surface, positive."""
        return _outermost(self.exemplars, index, self._stored(index, 0).seen_texels().cpu())

    def _scene(self, index: int, rng: np.random.Generator) -> Scene:
        return self.perturbation.scene(self.exemplars.scenes[index], index, rng)

    def _stored(self, index: int, variant: int) -> LightTransport:
        if (index, variant) not in self._held:
            scene = self._scene(index, np.random.default_rng([self.seed, index, variant]))
            path = self.exemplars.studio.folder / "cache" / "transports" / f"{self._key(scene)}.safetensors"
            if path.is_file():
                transport = LightTransport.load(path)
            else:
                transport = self._trace(index, scene).half()
                transport.save(path)
            self._held[index, variant] = transport.to(self.device)
        return self._held[index, variant]

    def _key(self, scene: Scene) -> str:
        """A name for all that the transport depends on."""
        renderer = f"{type(self.renderer).__qualname__}{self.renderer.capabilities.max_bounces}"
        described = scene.model_dump_json(exclude={"weathering", "renderer", "spp", "maps"})
        return hashlib.sha256(f"{described}{renderer}{self.spp}".encode()).hexdigest()[:24]

    def _trace(self, index: int, scene: Scene) -> LightTransport:
        subject, number = self.exemplars.subject(index), int(self.exemplars.subject_of[index])
        if number not in self._prepared:
            self._prepared.clear()
            self._prepared[number] = self.renderer.prepare(subject.surface)
        view = self.exemplars.studio.view(scene)
        assert isinstance(self.renderer, TransportRenderer)
        transport = build_transport(
            self.renderer.transport(self._prepared[number], view, spp=self.spp, seed=scene.seed),
            materials=subject.materials(scene.materials, None),
            learnable=subject.learnable,
            guide=subject.geometry.permute(1, 2, 0),
            view=view,
            spp=self.spp,
            repeat=subject.surface.repeat,
        )
        return transport.to(self.device)

    def _base(self, indices: Sequence[int], transports: Sequence[LightTransport]) -> Tensor:
        bases = [
            self.exemplars.subject(index).base_colors(self.exemplars.scenes[index].materials)[part]
            for index, transport in zip(indices, transports, strict=True)
            for part in transport.parts
        ]
        if all(base.ndim == 1 for base in bases):
            return torch.stack(bases).reshape(-1, 1, 1, 3).to(self.device)
        size = (*self.exemplars.subjects[0].buffer.part.shape, 3)
        return torch.stack([base.expand(size) for base in bases]).to(self.device)


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
        return _outermost(self.exemplars, index, torch.stack(seen))

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


def _outermost(exemplars: Exemplars, index: int, seen: Float[Tensor, "parts rows cols"]) -> Float[Tensor, "rows cols"]:
    """Of each texel, what is said of the part that is outermost there."""
    subject = exemplars.subject(index)
    picked = torch.zeros_like(seen[0])
    for slot, part in enumerate(subject.learnable):
        mine = subject.buffer.part == part
        picked[mine] = seen[slot][mine]
    return picked
