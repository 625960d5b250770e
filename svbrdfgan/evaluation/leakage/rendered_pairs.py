"""Rendered pairs: pictures of both sides with the same layers or none, so that only confounders tell them apart."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplar_files import BRIGHTEST
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.generate import render_scene
from svbrdfgan.evaluation.leakage.confounders import Confounder, scenes_with
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.training.batches import BatchSource, exemplar_spp, make_scenes, own_buffers
from svbrdfgan.training.config import ScenesConfig
from svbrdfgan.training.discriminator_batch import ImageBatch
from svbrdfgan.training.resolve import ResolvedRun
from svbrdfgan.training.scene_batch import SceneRendering
from svbrdfgan.training.step import make_pair
from svbrdfgan.training.subject_inputs import subject_inputs
from svbrdfgan.types import layer_channels

_CHUNK = 8

Confounders = frozenset[Confounder]

_OF_EXEMPLARS: Confounders = frozenset({"noise", "renderer"})
"""Those that pictures of exemplars depend on."""


@dataclass(eq=False)
class RenderedPairs:
    """Renders both sides' pictures, with any of the configuration's confounders present or removed.

    Fakes always use the training's renderer, samples per pixel and stored transports. So pose and light are matched on
    the fakes' side, and noise and renderer on the exemplars' side. A fake never has its exemplar's seed.

    Attributes:
        run: the training run that is probed.
        chosen: indices of the exemplars that are rendered, in order.
        renderer: the training's renderer.
        exemplar_renderer: the data set's renderer.
        true_layers: whether both sides show the exemplars' true layers; else both are clean.
        progress: called with the number of pictures rendered since the last call.
        _rendered: a cache of the exemplars' images and coverage, by which of noise and renderer is present.
        _buffers: a cache of the exemplars' G-buffers and light buffers; empty until they are rendered.
    """

    run: ResolvedRun
    exemplars: Exemplars
    chosen: Sequence[int]
    renderer: CheckedRenderer
    exemplar_renderer: CheckedRenderer
    device: torch.device
    true_layers: bool
    progress: Callable[[int], None]
    _rendered: dict[Confounders, tuple[Tensor, Tensor]] = field(default_factory=dict)
    _buffers: list[Tensor | None] = field(default_factory=list)

    def steps(self, trials: Collection[Confounders]) -> int:
        """Pictures of which `render` reports for these, each called once."""
        exemplars = {present & _OF_EXEMPLARS for present in trials}
        return len(self.chosen) * (len(trials) + len(exemplars))

    def render(self, present: Confounders) -> tuple[ImageBatch, ImageBatch]:
        """Exemplars, and fakes of a generator that paints their true layers or nothing, as training would show them."""
        source, pairs = self._source(present), []
        for first in range(0, len(self.chosen), _CHUNK):
            indices = list(self.chosen[first : first + _CHUNK])
            scenes = source.scenes(indices, np.random.default_rng([self.run.config.seed, indices[0]]))
            with torch.no_grad():
                pairs.append(make_pair(source, indices, scenes, self._layers(indices)))
            self.progress(len(indices))
        real, fake = zip(*pairs, strict=True)
        return ImageBatch.cat(real), ImageBatch.cat(fake)

    def _source(self, present: Confounders) -> BatchSource:
        """The training's batches, with exemplars and fakes that differ in these confounders alone."""
        exemplars, config = self.exemplars, self.run.config
        own_scenes = self._scenes(scenes_with(config.scenes, frozenset()), exemplar_spp(config, exemplars))
        images, coverage = self._exemplars(present & _OF_EXEMPLARS, own_scenes)
        return BatchSource(
            exemplars=exemplars,
            fake_scenes=self._scenes(scenes_with(config.scenes, present), config.spp),
            own_scenes=own_scenes,
            buffers=subject_inputs(exemplars, self.device),
            real=ImageBatch(images, coverage, *self._own_buffers(own_scenes)),
            demodulated=self._demodulated,
        )

    @property
    def _demodulated(self) -> bool:
        return self.run.config.discriminator.compares == "reflectance"

    def _scenes(self, scenes: ScenesConfig, spp: int) -> SceneRendering:
        if scenes.matched:  # training stores these too, whatever its pool
            scenes = scenes.model_copy(update={"pool": 1})
        elif scenes != self.run.config.scenes:  # training never renders these, so they are not stored
            scenes = scenes.model_copy(update={"pool": 0})
        run = self.run.with_config(scenes=scenes, spp=spp)
        return make_scenes(run, self.exemplars, "train", self.renderer, self.device)

    def _exemplars(self, present: Confounders, own_scenes: SceneRendering) -> tuple[Tensor, Tensor]:
        """Images and coverage of the exemplars, in their own cameras and lights.

        A fake whose own light is divided out has no noise. So an exemplar has none either, unless noise is present.
        """
        if present not in self._rendered:
            exact = self._demodulated and not present
            rendered = self._exact(own_scenes) if exact else self._traced(present)
            images, coverage = zip(*rendered, strict=True)
            self._rendered[present] = self._scattered(images), self._scattered(coverage)
        return self._rendered[present]

    def _traced(self, present: Confounders) -> Iterator[tuple[Tensor, Tensor]]:
        """Yields images and coverage, rendered and rounded as exemplars are stored, with their own seeds.

        Exemplars that show what is wanted are taken as they are.
        """
        renderer = self.exemplar_renderer if "renderer" in present else self.renderer
        prepared, last = None, -1
        for index in self.chosen:
            subject, scene = int(self.exemplars.subject_of[index]), self.exemplars.scenes[index]
            spp = scene.spp if "noise" in present else self.run.fake_spp
            if self.true_layers and renderer is self.exemplar_renderer and spp == scene.spp:
                yield self.exemplars.images[index], self.exemplars.coverage[index]
            else:
                if subject != last:
                    prepared, last = renderer.prepare(self.exemplars.subject(index).surface), subject
                weathering = scene.weathering if self.true_layers else None
                shown = scene.model_copy(update={"weathering": weathering, "spp": spp})
                rendering = render_scene(self.exemplars.loader, renderer, shown, prepared)
                yield rendering.image.clamp(max=BRIGHTEST).half(), rendering.coverage.half()
            self.progress(1)

    def _exact(self, own_scenes: SceneRendering) -> Iterator[tuple[Tensor, Tensor]]:
        """Yields images and coverage by the light transport of the exemplars' own scenes."""
        for index in self.chosen:
            image, coverage = own_scenes.scenes([index], np.random.default_rng(0)).render(self._layers([index]))
            yield image[0], coverage[0]
            self.progress(1)

    def _own_buffers(self, own_scenes: SceneRendering) -> list[Tensor | None]:
        """`own_buffers` of the exemplars, which no confounder changes."""
        if not self._buffers:
            buffers = own_buffers(self.run.config.discriminator, own_scenes, self.chosen, self.exemplars.loader.cache)
            self._buffers.extend(None if buffer is None else self._scattered(buffer) for buffer in buffers)
        return self._buffers

    def _scattered(self, values: Sequence[Tensor] | Tensor) -> Tensor:
        """Each value at its exemplar's index; zeros at exemplars that were not chosen."""
        scattered = values[0].new_zeros(len(self.exemplars), *values[0].shape, device=self.device)
        scattered[list(self.chosen)] = torch.stack(list(values)).to(self.device)
        return scattered

    def _layers(self, indices: Sequence[int]) -> Float[Tensor, "batch rows cols channels"]:
        """The true layers of these exemplars, or layers of alpha 0."""
        layers = []
        for index in indices:
            scene, texels = self.exemplars.scenes[index], self.exemplars.subject(index).buffer.mask.shape
            layer = self.exemplars.loader.layer(scene) if self.true_layers else None
            layers.append(torch.zeros(*texels, layer_channels(scene.maps)) if layer is None else layer.values)
        return torch.stack(layers).to(self.device)
