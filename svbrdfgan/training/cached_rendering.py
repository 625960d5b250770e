"""Cached rendering: each scene is traced once and stored; then a sparse product renders any layer in it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.rendering.transport import LightTransport, TransportBatch, build_transport
from svbrdfgan.rendering.transport.cache import MemoryCache, PendingTransport, TransportReader
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.demodulation import Demodulator
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.training.scene_batch import (
    Coverage,
    Images,
    Layers,
    SceneBatch,
    SceneKey,
    chosen_scenes,
    of_outermost_parts,
    prepared_surface,
    with_progress,
)
from svbrdfgan.types import Layer
from svbrdfgan.utils.copy_async import copy_async


@dataclass(frozen=True, eq=False)
class CachedSceneBatch:
    """A batch of scenes whose light transport is stored.

    Attributes:
        batch: the light transports.
        base: base colour under the layer, for each texture of the batch.
    """

    batch: TransportBatch
    base: Float[Tensor, "textures *#size 3"]
    light_buffer: None = None
    """Never shown: pictures that are linear in their textures can be divided by their light instead."""

    @property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"]:
        return self.batch.gbuffer

    @cached_property
    def demodulator(self) -> Demodulator:
        """Divides the light of these scenes out of their pictures."""
        return Demodulator.of(self.batch)

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        textures = composite(self.base, Layer(layers.float().index_select(0, self.batch.owner)))
        return self.batch.render(textures), self.batch.coverage


def demodulator_of(scenes: SceneBatch) -> Demodulator:
    """The demodulator of a batch of cached scenes.

    Raises:
        TypeError: the scenes are rendered online. `TrainConfig` refuses such a configuration earlier.
    """
    if not isinstance(scenes, CachedSceneBatch):
        raise TypeError(f"{type(scenes).__name__} does not know what its pixels show")
    return scenes.demodulator


@dataclass(frozen=True, eq=False)
class CachedRendering:
    """Scenes for fakes by stored light transport: each is traced once and kept as a file in the data set's cache.

    The transports used last stay on the device, up to a quarter of its memory. The others are read again from their
    files; `prefetch` starts that before they are needed.

    Attributes:
        exemplars: their scenes are perturbed.
        perturbation: makes a scene for a fake from an exemplar's.
        renderer: traces the scenes.
        spp: samples per pixel.
        pool: scenes stored for each exemplar. With 0 every visit traces a new scene; surfaces stay prepared.
        device: where transports are held.
        seed: of the perturbations.
        options: the renderer's options. They are part of the file names, since other options trace other transports.
    """

    exemplars: Exemplars
    perturbation: Perturbation
    renderer: CheckedRenderer
    spp: int
    pool: int
    device: torch.device
    seed: int = 0
    options: Mapping[str, object] = field(default_factory=dict)
    _cache: MutableMapping[SceneKey, LightTransport] = field(default_factory=MemoryCache)
    _pending: dict[SceneKey, PendingTransport] = field(default_factory=dict)
    _paths: dict[SceneKey, Path] = field(default_factory=dict)
    _prepared: dict[int, Any] = field(default_factory=dict)
    _bases: dict[int, list[Tensor]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.renderer.capabilities.transport:
            raise ConfigError(
                f"rendering: stored needs a renderer that declares it; {self.renderer.name} does not: "
                "set rendering: online or choose another renderer."
            )

    def build(self, indices: Iterable[int], progress: Callable[[int], None] | None = None) -> None:
        """Traces scenes that are not stored yet, and reads all files once, to find damaged ones before training."""
        for index in with_progress(indices, progress):
            for variant in range(self.pool):
                self._stored((index, variant))

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> CachedSceneBatch:
        """A scene for each of these exemplars. `rng` chooses it from the pool, or draws it where there is no pool.

        `visit` changes nothing: gradients of stored transport are exact, and its noise is that of few exemplars.
        """
        if self.pool:
            transports = [self._stored(key) for key in chosen_scenes(indices, rng, self.pool)]
        else:
            transports = [self._trace(index, self._scene(index, rng)).to(self.device) for index in indices]
        return CachedSceneBatch(TransportBatch.stack(transports), self._base(indices))

    def in_scenes(self, config: ScenesConfig, spp: int) -> CachedRendering:
        """The same exemplars in otherwise perturbed scenes, one for each, with a cache of its own."""
        perturbation = Perturbation(config, self.perturbation.sampler)
        return CachedRendering(
            self.exemplars, perturbation, self.renderer, spp, 1, self.device, self.seed, self.options
        )

    def batch(self, indices: Sequence[int]) -> TransportBatch:
        """The light transport of the first stored scene of each of these exemplars."""
        return TransportBatch.stack([self._stored((index, 0)) for index in indices])

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Starts to read the transports that `scenes` will need for these exemplars, given an equal `rng`.

        Returns at once. Prefetched transports do not count towards the memory budget of the cache. The budget should
        hold at least two batches, so that one batch does not evict what the next one needs too.
        """
        if not self.pool:
            return
        for key in chosen_scenes(indices, rng, self.pool):
            if key in self._paths and key not in self._pending and self._cache.get(key) is None:
                self._pending[key] = self._reader.read(self._paths[key])

    def gbuffer(self, index: int) -> Float[Tensor, "height width 6"]:
        """Position and normal per pixel of the first stored scene of an exemplar."""
        return self._stored((index, 0)).gbuffer

    def light_buffer(self, index: int) -> None:
        """None: stored light can be divided out, and is not shown."""

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface."""
        return of_outermost_parts(self.exemplars, index, self._stored((index, 0)).seen_texels().cpu())

    def _scene(self, index: int, rng: np.random.Generator) -> Scene:
        return self.perturbation.scene(self.exemplars.scenes[index], index, rng)

    def _stored(self, key: SceneKey) -> LightTransport:
        found = self._cache.get(key)
        if found is None:
            pending = self._pending.pop(key, None)
            found = LightTransport.load(self._file(key)).to(self.device) if pending is None else pending.result()
            self._cache[key] = found
        return found

    def _file(self, key: SceneKey) -> Path:
        """The file of a scene's transport. It traces the scene if the file is not there."""
        if key not in self._paths:
            index, variant = key
            scene = self._scene(index, np.random.default_rng([self.seed, index, variant]))
            path = self.exemplars.loader.folder / "cache" / "transports" / f"{self._key(scene)}.safetensors"
            if not path.is_file():
                self._trace(index, scene).half().save(path)
            self._paths[key] = path
        return self._paths[key]

    @cached_property
    def _reader(self) -> TransportReader:
        return TransportReader(self.device)

    def _key(self, scene: Scene) -> str:
        """A hash of everything that the transport depends on."""
        kind = type(self.renderer.plugin)
        options = json.dumps({name: value for name, value in self.options.items() if name != "device"}, sort_keys=True)
        renderer = f"{kind.__module__}.{kind.__qualname__}{options}"
        described = scene.model_dump_json(exclude={"weathering", "renderer", "spp", "maps"})
        return hashlib.sha256(f"{described}{renderer}{self.spp}".encode()).hexdigest()[:24]

    def _trace(self, index: int, scene: Scene) -> LightTransport:
        subject = self.exemplars.subject(index)
        if self.pool and int(self.exemplars.subject_of[index]) not in self._prepared:
            self._prepared.clear()  # `build` traces the scenes of a subject in a row, and each once
        view = self.exemplars.loader.view(scene)
        prepared = prepared_surface(self.exemplars, index, self.renderer, self._prepared)
        return build_transport(
            self.renderer.transport(prepared, view, spp=self.spp, seed=scene.seed),
            materials=subject.materials(base_colors=scene.materials),
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
        """The base colour of each learnable part."""
        if index not in self._bases:
            subject = self.exemplars.subject(index)
            colors = subject.base_colors(self.exemplars.scenes[index].materials)
            self._bases[index] = [colors[part] for part in subject.learnable]
        return self._bases[index]
