"""Where fakes are rendered: batches of scenes, ready to show any layers by their stored transport."""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.protocols import Renderer, TransportRenderer
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.rendering.transport import LightTransport, TransportBatch, build_transport
from svbrdfgan.rendering.transport.cache import Reader, Reading, TransportCache
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.demodulation import Sight
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.utils.copy_async import copy_async

Layers = Float[Tensor, "batch rows cols channels"]
Images = Float[Tensor, "batch height width 3"]
Coverage = Float[Tensor, "batch height width"]

_Key = tuple[int, int]
"""An exemplar, and which of the scenes kept for it."""

log = logging.getLogger(__name__)


class Stage(Protocol):
    """A batch of scenes. `gbuffer` is position and normal as seen, premultiplied; None if the renderer cannot tell."""

    @property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"] | None: ...

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        """The pictures of these layers on the learnable parts, differentiable in the layers; and their coverage."""
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
    def gbuffer(self) -> Float[Tensor, "batch height width 6"]:
        return self.batch.gbuffer

    @cached_property
    def sight(self) -> Sight:
        """What the scenes show of the textures."""
        return Sight.of(self.batch)

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        textures = composite(self.base, layers.float().index_select(0, self.batch.owner))
        return self.batch.render(textures), self.batch.coverage


def sight_of(stage: Stage) -> Sight:
    """What a stage of stored transports shows of its textures.

    Raises:
        TypeError: it is of another kind, which configurations do not allow where this is wanted.
    """
    if not isinstance(stage, TransportStage):
        raise TypeError(f"{type(stage).__name__} does not know what its pixels show")
    return stage.sight


@dataclass(frozen=True, eq=False)
class Transports:
    """Stages of stored transports: each scene is traced once and kept as a file in the data set's cache.

    As many as fit into a quarter of the device's memory are held there, those used last. The others are read again from
    their files, which the system keeps in what memory it has free; `expect` has that done before they are wanted.

    Attributes:
        exemplars: whose scenes to perturb.
        perturbation: how.
        renderer: traces them.
        spp: samples per pixel.
        pool: scenes kept for each exemplar; 0 traces a new one at every visit, of surfaces that stay prepared.
        device: where transports are held.
        seed: of the perturbations.
        options: the renderer's, lest those of others be taken for its transports.
    """

    exemplars: Exemplars
    perturbation: Perturbation
    renderer: Renderer[Any]
    spp: int
    pool: int
    device: torch.device
    seed: int = 0
    options: Mapping[str, object] = field(default_factory=dict)
    _held: MutableMapping[_Key, LightTransport] = field(default_factory=TransportCache)
    _coming: dict[_Key, Reading] = field(default_factory=dict)
    _paths: dict[_Key, Path] = field(default_factory=dict)
    _prepared: dict[int, Any] = field(default_factory=dict)
    _bases: dict[int, list[Tensor]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.renderer, TransportRenderer) or not self.renderer.capabilities.transport:
            raise ConfigError(
                f"rendering: transport needs a renderer that declares it; {type(self.renderer).__name__} does not: "
                "set rendering: fresh or choose another renderer."
            )

    def build(self, indices: Iterable[int], progress: Callable[[int], None] | None = None) -> None:
        """Traces what is not stored yet, and reads all stored scenes once: a damaged file is found before training."""
        for index in indices:
            for variant in range(self.pool):
                self._stored((index, variant))
            if progress is not None:
                progress(1)

    def stage(self, indices: Sequence[int], rng: np.random.Generator) -> TransportStage:
        """A scene for each of these exemplars; `rng` chooses among the pool, or draws the scene."""
        if self.pool:
            transports = [self._stored(key) for key in self._chosen(indices, rng)]
        else:
            transports = [self._trace(index, self._scene(index, rng)).to(self.device) for index in indices]
        return TransportStage(TransportBatch.stack(transports), self._base(indices))

    def batch(self, indices: Sequence[int]) -> TransportBatch:
        """The first scene kept for each of these exemplars."""
        return TransportBatch.stack([self._stored((index, 0)) for index in indices])

    def expect(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Begins to read what a later `stage` will want of these exemplars, given a generator in the same state.

        Returns at once. What is read so waits beside the held transports, whatever their budget; that should be two
        batches at least, lest one batch drive out what the next one wants as well.
        """
        if not self.pool:
            return
        for key in self._chosen(indices, rng):
            if key in self._paths and key not in self._coming and self._held.get(key) is None:
                self._coming[key] = self._reader.read(self._paths[key])

    def gbuffer(self, index: int) -> Float[Tensor, "height width 6"]:
        """Position and normal as seen in the first scene kept for an exemplar."""
        return self._stored((index, 0)).gbuffer

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Where an exemplar's picture shows the outermost learnable surface, positive."""
        return outermost(self.exemplars, index, self._stored((index, 0)).seen_texels().cpu())

    def _scene(self, index: int, rng: np.random.Generator) -> Scene:
        return self.perturbation.scene(self.exemplars.scenes[index], index, rng)

    def _chosen(self, indices: Sequence[int], rng: np.random.Generator) -> list[_Key]:
        """Which stored scene of each exemplar."""
        return [(index, int(rng.integers(self.pool))) for index in indices]

    def _stored(self, key: _Key) -> LightTransport:
        held = self._held.get(key)
        if held is None:
            coming = self._coming.pop(key, None)
            held = LightTransport.load(self._file(key)).to(self.device) if coming is None else coming.result()
            self._held[key] = held
        return held

    def _file(self, key: _Key) -> Path:
        """Where the transport is stored, traced if it is not yet."""
        if key not in self._paths:
            index, variant = key
            scene = self._scene(index, np.random.default_rng([self.seed, index, variant]))
            path = self.exemplars.studio.folder / "cache" / "transports" / f"{self._key(scene)}.safetensors"
            if not path.is_file():
                self._trace(index, scene).half().save(path)
            self._paths[key] = path
        return self._paths[key]

    @cached_property
    def _reader(self) -> Reader:
        return Reader(self.device)

    def _key(self, scene: Scene) -> str:
        """A name for all that the transport depends on."""
        kind = type(self.renderer)
        options = json.dumps({name: value for name, value in self.options.items() if name != "device"}, sort_keys=True)
        renderer = f"{kind.__module__}.{kind.__qualname__}{options}"
        described = scene.model_dump_json(exclude={"weathering", "renderer", "spp", "maps"})
        return hashlib.sha256(f"{described}{renderer}{self.spp}".encode()).hexdigest()[:24]

    def _trace(self, index: int, scene: Scene) -> LightTransport:
        subject = self.exemplars.subject(index)
        if self.pool and int(self.exemplars.subject_of[index]) not in self._prepared:
            self._prepared.clear()  # the scenes of a subject are traced in a row, and once
        view = self.exemplars.studio.view(scene)
        prepared = surface_of(self.exemplars, index, self.renderer, self._prepared)
        assert isinstance(self.renderer, TransportRenderer)
        return build_transport(
            self.renderer.transport(prepared, view, spp=self.spp, seed=scene.seed),
            materials=subject.materials(scene.materials, None),
            learnable=subject.learnable,
            gbuffer=subject.geometry.permute(1, 2, 0),
            view=view,
            spp=self.spp,
            repeat=subject.surface.repeat,
        )

    def _base(self, indices: Sequence[int]) -> Tensor:
        bases = [base for index in indices for base in self._bases_of(index)]
        if all(base.ndim == 1 for base in bases):
            return copy_async(torch.stack(bases).reshape(-1, 1, 1, 3), self.device)
        size = (*self.exemplars.subjects[0].buffer.part.shape, 3)
        return copy_async(torch.stack([base.expand(size) for base in bases]), self.device)

    def _bases_of(self, index: int) -> list[Tensor]:
        """Of each learnable part."""
        if index not in self._bases:
            subject = self.exemplars.subject(index)
            colors = subject.base_colors(self.exemplars.scenes[index].materials)
            self._bases[index] = [colors[part] for part in subject.learnable]
        return self._bases[index]


def surface_of(exemplars: Exemplars, index: int, renderer: Renderer[Any], kept: dict[int, Any]) -> Any:
    """An exemplar's surface as its renderer prepared it, now or before; `kept` holds those, by subject."""
    number = int(exemplars.subject_of[index])
    if number not in kept:
        kept[number] = renderer.prepare(exemplars.subjects[number].surface)
    return kept[number]


def outermost(exemplars: Exemplars, index: int, seen: Float[Tensor, "parts rows cols"]) -> Float[Tensor, "rows cols"]:
    """Of each texel, what is said of the part that is outermost there."""
    subject = exemplars.subject(index)
    picked = torch.zeros_like(seen[0])
    for slot, part in enumerate(subject.learnable):
        mine = subject.buffer.part == part
        picked[mine] = seen[slot][mine]
    return picked
