"""Cached rendering: each scene is traced once and stored; then a sparse product renders any layer in it."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.metrics.recovered import SeenTexels
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.rendering.compositing import composite
from svbrdfgan.rendering.transport.build import build_transport
from svbrdfgan.rendering.transport.cache import TransportStore
from svbrdfgan.rendering.transport.light_transport import LightTransport
from svbrdfgan.rendering.transport.product import TransportBatch
from svbrdfgan.scene.description import Scene
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.demodulation import Demodulator
from svbrdfgan.training.perturb import Perturbation
from svbrdfgan.training.scene_batch import (
    Coverage,
    Images,
    Layers,
    PreparedSurfaces,
    Progress,
    SceneKey,
    chosen_scenes,
    of_outermost_parts,
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
    clean: None = None
    """Never shown, for the same reason."""

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


@dataclass(eq=False)
class CachedRendering:
    """Scenes for fakes by stored light transport: each is traced once and kept as a file in the data set's cache.

    The transports used last stay on the device. The others are read again from their files; `prefetch` starts that
    before they are needed. Prepared surfaces and base colours stay in memory too; of windows, the surfaces
    that were prepared last, and no textures. `dataclasses.replace` gives the same scenes with nothing in memory yet.

    Attributes:
        exemplars: their scenes are perturbed.
        perturbation: makes a scene for a fake from an exemplar's.
        renderer: traces the scenes.
        spp: samples per pixel.
        pool: scenes stored for each exemplar. With 0 every visit traces a new scene; surfaces stay prepared.
        device: where transports are held.
        seed: of the perturbations.
        options: the renderer's options. They are part of the file names, since other options trace other transports.
        cache_bytes: memory for transports; None takes a quarter of the device's, and 0 keeps only the last one.
    """

    exemplars: Exemplars
    perturbation: Perturbation
    renderer: CheckedRenderer
    spp: int
    pool: int
    device: torch.device
    seed: int = 0
    options: Mapping[str, object] = field(default_factory=dict)
    cache_bytes: int | None = None

    def __post_init__(self) -> None:
        if not self.renderer.capabilities.transport:
            raise ConfigError(
                f"rendering: stored needs a renderer that declares it; {self.renderer.name} does not: "
                "set rendering: online or choose another renderer."
            )
        self._transports: TransportStore[SceneKey] = TransportStore(self.device, self.cache_bytes)
        # with a pool, `build` traces the scenes of a subject in a row, and each once
        self._surfaces = PreparedSurfaces(self.exemplars, self.renderer, single=self.pool > 0)
        self._bases: dict[int, list[Tensor]] = {}

    def build(self, indices: Iterable[int], progress: Progress | None = None) -> None:
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
        return self._batch(transports, indices)

    def first_scenes(self, indices: Sequence[int]) -> CachedSceneBatch:
        """The first stored scene of each of these exemplars."""
        return self._batch([self._stored((index, 0)) for index in indices], indices)

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Starts to read the transports that `scenes` will need for these exemplars, given an equal `rng`.

        Returns at once.
        """
        if self.pool:
            for key in chosen_scenes(indices, rng, self.pool):
                self._transports.prefetch(key)

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface."""
        return of_outermost_parts(self.exemplars, index, self._stored((index, 0)).seen_texels().cpu())

    def own_scenes(self, spp: int, *, keep: bool) -> CachedRendering:
        """The exemplars' own scenes, one for each; in main memory, one at a time, if they are not to be kept."""
        device, cache_bytes = (self.device, self.cache_bytes) if keep else (torch.device("cpu"), 0)
        return self._in_scenes(ScenesConfig(), spp, device, cache_bytes)

    def seen_in(self, config: ScenesConfig) -> SeenTexels:
        """`seen` of otherwise perturbed scenes, one for each exemplar, held in main memory."""
        return self._in_scenes(config, self.spp, torch.device("cpu"), None).seen

    def resampled(self, spp: int) -> None:
        """None: pictures are of stored samples."""

    def _in_scenes(
        self, config: ScenesConfig, spp: int, device: torch.device, cache_bytes: int | None
    ) -> CachedRendering:
        return replace(
            self,
            perturbation=Perturbation(config, self.perturbation.sampler),
            spp=spp,
            pool=1,
            device=device,
            cache_bytes=cache_bytes,
        )

    def _scene(self, index: int, rng: np.random.Generator) -> Scene:
        return self.perturbation.scene(self.exemplars.scenes[index], index, rng)

    def _stored(self, key: SceneKey) -> LightTransport:
        return self._transports.get(key, self._file)

    def _file(self, key: SceneKey) -> Path:
        """The file of a scene's transport. It traces the scene if the file is not there."""
        index, variant = key
        scene = self._scene(index, np.random.default_rng([self.seed, index, variant]))
        path = self.exemplars.loader.folder / "cache" / "transports" / f"{self._key(scene)}.safetensors"
        if not path.is_file():
            self._trace(index, scene).half().save(path)
        return path

    def _key(self, scene: Scene) -> str:
        """A hash of everything that the transport depends on."""
        kind = type(self.renderer.plugin)
        options = json.dumps({name: value for name, value in self.options.items() if name != "device"}, sort_keys=True)
        renderer = f"{kind.__module__}.{kind.__qualname__}{options}"
        described = scene.model_dump_json(exclude={"weathering", "renderer", "spp", "maps"})
        return hashlib.sha256(f"{described}{renderer}{self.spp}".encode()).hexdigest()[:24]

    def _trace(self, index: int, scene: Scene) -> LightTransport:
        subject, view = self.exemplars.subject(index), self.exemplars.loader.view(scene)
        return build_transport(
            self.renderer.transport(self._surfaces.of(index), view, spp=self.spp, seed=scene.seed),
            materials=subject.materials(base_colors=scene.materials),
            learnable=subject.learnable,
            gbuffer=subject.geometry.permute(1, 2, 0),
            view=view,
            spp=self.spp,
            repeat=subject.surface.repeat,
        )

    def _batch(self, transports: Sequence[LightTransport], indices: Sequence[int]) -> CachedSceneBatch:
        bases = [base for index in indices for base in self._bases_of(index)]
        size = torch.broadcast_shapes((1, 1, 3), *(base.shape for base in bases))
        base = copy_async(torch.stack([base.expand(size) for base in bases]), self.device)
        return CachedSceneBatch(TransportBatch.stack(transports), base)

    def _bases_of(self, index: int) -> list[Tensor]:
        """The base colour of each learnable part. Textures of windows are not kept: each exemplar has its own."""
        if index in self._bases:
            return self._bases[index]
        subject, scene = self.exemplars.subject(index), self.exemplars.scenes[index]
        colors = subject.base_colors(scene.materials)
        bases = [colors[part] for part in subject.learnable]
        if scene.window is None:
            self._bases[index] = bases
        elif all(base.ndim == 1 for base in bases):
            self._bases[index] = [base.clone() for base in bases]  # what was read of a file holds all of it in memory
        return bases
