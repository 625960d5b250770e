"""Deferred rendering: hits and light of each scene are stored once; then any layer of whole materials is shaded."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import ConfigError
from svbrdfgan.rendering.checked_renderer import CheckedLight, CheckedRenderer
from svbrdfgan.rendering.compositing import composite_values
from svbrdfgan.rendering.shade_layer import shade
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
    SceneKey,
    chosen_scenes,
    seen_in_gradient,
    with_progress,
)
from svbrdfgan.types import CHANNELS, Layer, Material
from svbrdfgan.utils.copy_async import copy_async
from svbrdfgan.utils.memory_cache import MemoryCache

_MOST = 4.0
"""The largest ratio of a clean picture to one of a few samples."""


@dataclass(frozen=True, eq=False)
class DeferredScene:
    """A scene whose light is stored.

    Attributes:
        light: of the learnable parts.
        background: the picture of all other parts, premultiplied.
        lit: that of the learnable parts without a layer, with little noise, by other samples than `clean`; None if
            pictures keep their noise.
        coverage: share of each pixel that shows the surface.
        gbuffer: position and normal of the learnable parts, premultiplied; half precision; None if the discriminator
            is not shown it.
        light_buffer: see `ReferencePictures.light_buffer`; likewise.
        clean: see `ReferencePictures.clean`; likewise.
        base: the maps under the layer, for each learnable part.
    """

    light: CheckedLight
    background: Float[Tensor, "height width 3"]
    lit: Float[Tensor, "height width 3"] | None
    coverage: Float[Tensor, "height width"]
    gbuffer: Float[Tensor, "height width 6"] | None
    light_buffer: Float[Tensor, "height width 9"] | None
    clean: Float[Tensor, "height width 3"] | None
    base: Float[Tensor, "parts *#size values"]

    @property
    def nbytes(self) -> int:
        tensors = (self.background, self.lit, self.coverage, self.gbuffer, self.light_buffer, self.clean, self.base)
        return self.light.nbytes + sum(tensor.nbytes for tensor in tensors if tensor is not None)

    @property
    def device(self) -> torch.device:
        return self.background.device


@dataclass(frozen=True, eq=False)
class DeferredSceneBatch:
    """A batch of scenes whose light is stored.

    Attributes:
        maps: that layers paint, base_color first.
        visit, seed: of `DeferredRenderer.shade`.
        matched: whether they are the exemplars' scenes.
    """

    renderer: CheckedRenderer
    scenes: tuple[DeferredScene, ...]
    maps: tuple[str, ...]
    visit: int
    seed: int
    matched: bool
    demodulator: None = None
    """Pictures of whole materials are not linear in their textures."""

    @cached_property
    def gbuffer(self) -> Float[Tensor, "batch height width 6"] | None:
        return self._unless_matched(scene.gbuffer for scene in self.scenes)

    @cached_property
    def light_buffer(self) -> Float[Tensor, "batch height width 9"] | None:
        return self._unless_matched(scene.light_buffer for scene in self.scenes)

    @cached_property
    def clean(self) -> Float[Tensor, "batch height width 3"] | None:
        return self._unless_matched(scene.clean for scene in self.scenes)

    def _unless_matched(self, buffers: Iterable[Tensor | None]) -> Tensor | None:
        known = [] if self.matched else [buffer for buffer in buffers if buffer is not None]
        return torch.stack(known).float() if known else None

    @cached_property
    def coverage(self) -> Coverage:
        return torch.stack([scene.coverage for scene in self.scenes])

    def render(self, layers: Layers) -> tuple[Images, Coverage]:
        painted, base = Layer(layers.float().index_select(0, self._owner), self.maps[1:]), self._base
        lights = [scene.light for scene in self.scenes]
        samples: Any = {"maps": self.maps, "visit": self.visit, "seed": self.seed}
        shown = shade(self.renderer, lights, composite_values(base, painted), **samples)
        lit = [scene.lit for scene in self.scenes if scene.lit is not None]
        if lit:
            shown = shown * _ratio(torch.stack(lit), self.renderer.shade(lights, base, **samples)[0])
        return shown + torch.stack([scene.background for scene in self.scenes]), self.coverage

    @property
    def _base(self) -> Float[Tensor, "textures *#size values"]:
        bases = [scene.base for scene in self.scenes]
        rows, cols = (max(base.shape[axis] for base in bases) for axis in (1, 2))
        return torch.cat([base.expand(-1, rows, cols, -1) for base in bases])

    @property
    def _owner(self) -> Int[Tensor, " textures"]:
        """The scene of each texture."""
        owners = [number for number, scene in enumerate(self.scenes) for _ in scene.base]
        return copy_async(torch.tensor(owners), self.coverage.device)


@dataclass(eq=False)
class DeferredRendering:
    """Scenes for fakes by stored light: what does not depend on the layer is traced once, and shaded at each visit.

    Unlike stored light transport it serves whole materials, in which pictures are not linear. What it stores stays on
    the device; what is dropped is traced again, which takes about as long as reading it. Prepared surfaces stay in
    memory too; of windows, the last ones. `dataclasses.replace` gives the same scenes with nothing in memory yet.

    Attributes:
        exemplars: their scenes are perturbed.
        perturbation: makes a scene for a fake from an exemplar's.
        renderer: traces and shades the scenes.
        spp: camera samples per pixel that are traced.
        hits: the most of them that are kept, of those that hit learnable parts.
        pool: scenes stored for each exemplar. With 0 every visit traces a new scene; surfaces stay prepared.
        device: where layers are.
        seed: of the perturbations.
        shows_gbuffer: whether the discriminator is shown a G-buffer.
        shows_light: whether it is shown a light buffer.
        shows_clean: whether it is shown clean pictures.
        cache_bytes: memory for stored scenes; None takes half of the device's, and 0 keeps only the last one.
        clean_spp: samples per pixel of clean pictures, by whose ratio to ones of the same samples pictures are
            multiplied (ratio estimator; Heitz et al. 2018), so that they have hardly more noise than those; None: not.
    """

    exemplars: Exemplars
    perturbation: Perturbation
    renderer: CheckedRenderer
    spp: int
    hits: int
    pool: int
    device: torch.device
    seed: int = 0
    shows_gbuffer: bool = True
    shows_light: bool = False
    shows_clean: bool = False
    cache_bytes: int | None = None
    clean_spp: int | None = None

    def __post_init__(self) -> None:
        if not self.renderer.capabilities.deferred:
            raise ConfigError(
                "rendering: stored of whole materials needs a renderer that stores light; "
                f"{self.renderer.name} does not: set rendering: online or choose another renderer."
            )
        self._cache: MemoryCache[SceneKey, DeferredScene] = MemoryCache(self.cache_bytes, share=0.5)
        self._surfaces = PreparedSurfaces(self.exemplars, self.renderer)

    @property
    def maps(self) -> tuple[str, ...]:
        """The maps that layers paint, base_color first."""
        return tuple(name for name in CHANNELS if name in {"base_color", *self.exemplars.scenes[0].maps})

    def build(self, indices: Iterable[int], progress: Progress | None = None) -> None:
        """Stores the light of scenes that are not stored yet, as far as memory holds it; none if nothing is kept."""
        if self.cache_bytes == 0:
            return
        for index in with_progress(indices, progress):
            for variant in range(self.pool):
                self._stored((index, variant))

    def scenes(self, indices: Sequence[int], rng: np.random.Generator, visit: int = 0) -> DeferredSceneBatch:
        """A scene for each of these exemplars. `rng` chooses it from the pool, or draws it where there is no pool."""
        if self.pool:
            scenes = [self._stored(key) for key in chosen_scenes(indices, rng, self.pool)]
        else:
            scenes = [
                self._trace(index, self.perturbation.scene(self.exemplars.scenes[index], index, rng))
                for index in indices
            ]
        matched, seed = self.perturbation.config.matched, int(rng.integers(2**31))
        return DeferredSceneBatch(self.renderer, tuple(scenes), self.maps, visit, seed, matched)

    def first_scenes(self, indices: Sequence[int]) -> DeferredSceneBatch:
        """The first stored scene of each of these exemplars."""
        scenes = tuple(self._stored((index, 0)) for index in indices)
        return DeferredSceneBatch(self.renderer, scenes, self.maps, visit=0, seed=0, matched=False)

    def prefetch(self, indices: Sequence[int], rng: np.random.Generator) -> None:
        """Does nothing: what is stored is in memory."""

    def seen(self, index: int) -> Float[Tensor, "rows cols"]:
        """Positive at texels that an exemplar's picture shows of the outermost learnable surface."""
        return seen_in_gradient(self.exemplars, index, self.renderer, self._surfaces.of(index), self.spp)

    def own_scenes(self, spp: int, *, keep: bool) -> DeferredRendering:
        """The exemplars' own scenes, one for each; on the device one at a time, if they are not to be kept."""
        unperturbed, budget = Perturbation(ScenesConfig(), self.perturbation.sampler), self.cache_bytes if keep else 0
        own = replace(self, perturbation=unperturbed, spp=spp, pool=1, cache_bytes=budget)
        own._surfaces = self._surfaces  # the same in all scenes, and costly to prepare
        return own

    def seen_in(self, config: ScenesConfig) -> None:
        """None: what is seen is known of the exemplars' own pictures alone."""

    def resampled(self, spp: int) -> None:
        """None: pictures are of stored samples."""

    def _stored(self, key: SceneKey) -> DeferredScene:
        found = self._cache.get(key)
        if found is None:
            index, variant = key
            rng = np.random.default_rng([self.seed, index, variant])
            found = self._trace(index, self.perturbation.scene(self.exemplars.scenes[index], index, rng))
            self._cache[key] = found
        return found

    def _trace(self, index: int, scene: Scene) -> DeferredScene:
        subject, view = self.exemplars.subject(index), self.exemplars.loader.view(scene)
        renderer, prepared = self.renderer, self._surfaces.of(index)
        shown = ReferencePictures(renderer, prepared, subject, scene, view, self.spp, self.clean_spp)
        if self.clean_spp is None:
            lit, beside = None, renderer.render(prepared, shown.others, view, spp=self.spp, seed=scene.seed)
        else:  # if the discriminator were shown the same picture, it would tell fakes by its noise, which they share
            apart = replace(shown, stream=1)
            beside = apart.beside()
            lit = (apart.clean().to(self.device) - beside.image.to(self.device)).clamp(min=0.0)
        light = renderer.store_light(
            prepared, view, learnable=subject.learnable, hits=self.hits, spp=self.spp, seed=scene.seed
        )
        return DeferredScene(
            light=light,
            background=beside.image.to(self.device),
            lit=lit,
            coverage=beside.coverage.to(self.device),
            gbuffer=shown.gbuffer().half().to(self.device) if self.shows_gbuffer else None,
            light_buffer=shown.light_buffer().to(self.device) if self.shows_light else None,
            clean=shown.clean().to(self.device) if self.shows_clean else None,
            base=_stacked([shown.bare[part] for part in subject.learnable], self.maps).to(self.device),
        )


def _ratio(clean: Images, own: Images) -> Images:
    """What takes away the noise of a clean picture's samples; they may miss all light."""
    return torch.where(own > 0.0, clean / own, 1.0).clamp(max=_MOST)


def _stacked(materials: Sequence[Material], names: Sequence[str]) -> Float[Tensor, "materials *#size values"]:
    """The named maps of the materials, side by side; of one texel if all are constant."""
    size = torch.broadcast_shapes(*(m.maps[name].shape[:-1] for m in materials for name in names))
    rows, cols = size or (1, 1)
    return torch.stack([torch.cat([m.maps[name].expand(rows, cols, -1) for name in names], dim=-1) for m in materials])
