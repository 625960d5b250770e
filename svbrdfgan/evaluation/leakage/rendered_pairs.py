"""Clean pictures of both sides: unweathered, so that whatever tells them apart is a nuisance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.generate import BRIGHTEST, render_scene
from svbrdfgan.evaluation.leakage.confounders import Nuisance, scenes_with
from svbrdfgan.evaluation.leakage.stills import Stills
from svbrdfgan.protocols import Renderer
from svbrdfgan.rendering.compositing import layer_channels
from svbrdfgan.training.batches import Feed, buffers_of, make_stages, own_spp
from svbrdfgan.training.cached_rendering import Transports
from svbrdfgan.training.config import ScenesConfig, TrainConfig
from svbrdfgan.training.online_rendering import FreshRenders
from svbrdfgan.training.step import sides

_CHUNK = 8

Differing = frozenset[Nuisance]


@dataclass(frozen=True, eq=False)
class Darkroom:
    """Makes both sides' clean pictures, with any of the configuration's nuisances present or taken away.

    Fakes are always of the training's renderer, samples and stored transports. So scenes are matched on the side of
    the fakes, samples and renderer on that of the exemplars; whatever seed makes a fake, it is not its exemplar's.

    Attributes:
        chosen: the exemplars, in order.
        renderer, made_with: the training's, and the data set's.
        base: the folder that paths of the configuration are relative to.
        progress: told how many pictures were made.
    """

    config: TrainConfig
    exemplars: Exemplars
    chosen: Sequence[int]
    renderer: Renderer[Any]
    made_with: Renderer[Any]
    device: torch.device
    base: Path
    progress: Callable[[int], None]
    _made: dict[Differing, tuple[Tensor, Tensor]] = field(default_factory=dict)

    def pair(self, differing: Differing) -> tuple[Stills, Stills]:
        """Exemplars' clean twins, and fakes of a generator that paints nothing, as training would show them."""
        feed, shots = self._feed(differing), []
        for first in range(0, len(self.chosen), _CHUNK):
            indices = list(self.chosen[first : first + _CHUNK])
            stage = feed.stage(indices, np.random.default_rng([self.config.seed, indices[0]]))
            with torch.no_grad():
                shots.append(sides(feed, indices, stage, self._nothing(len(indices))))
            self.progress(len(indices))
        real, fake = (Stills.of(*side) for side in zip(*shots, strict=True))
        return real, fake

    def _feed(self, differing: Differing) -> Feed:
        """Training's, but that its exemplars are clean, and that fakes differ from them in these nuisances alone."""
        exemplars, scenes = self.exemplars, self.config.scenes
        own = self._stages(scenes_with(scenes, frozenset()), own_spp(self.config, exemplars))
        images, coverage = self._twins(differing & {"noise", "renderer"}, own)
        return Feed(
            exemplars=exemplars,
            stages=self._stages(scenes_with(scenes, differing), self.config.spp),
            own=own,
            buffers=buffers_of(exemplars, self.device),
            images=images,
            coverage=coverage,
            gbuffers=self._gbuffers(own),
            demodulated=self._demodulated,
        )

    @property
    def _demodulated(self) -> bool:
        return self.config.discriminator.sees == "reflectance"

    def _stages(self, scenes: ScenesConfig, spp: int) -> Transports | FreshRenders:
        if scenes.matched:  # which training stores too, whatever its pool
            scenes = scenes.model_copy(update={"pool": 1})
        elif scenes != self.config.scenes:  # which training never sees: not to be stored
            scenes = scenes.model_copy(update={"pool": 0})
        config = self.config.model_copy(update={"scenes": scenes, "spp": spp})
        return make_stages(config, self.exemplars, "train", self.renderer, self.device, self.base)

    def _twins(self, differing: Differing, own: Transports | FreshRenders) -> tuple[Tensor, Tensor]:
        """Images and coverage of the exemplars' clean twins: their own cameras and lights.

        Divided by its own light, a fake has no noise. So neither has a twin whose noise is taken away.
        """
        if differing not in self._made:
            exact = self._demodulated and not differing
            twins = self._exact(own) if exact else self._rendered(differing)
            images, coverage = zip(*twins, strict=True)
            self._made[differing] = self._placed(images), self._placed(coverage)
        return self._made[differing]

    def _rendered(self, differing: Differing) -> Iterator[tuple[Tensor, Tensor]]:
        """As exemplars are made and stored, their own seeds included."""
        renderer = self.made_with if "renderer" in differing else self.renderer
        prepared, last = None, -1
        for index in self.chosen:
            subject, scene = int(self.exemplars.subject_of[index]), self.exemplars.scenes[index]
            if subject != last:
                prepared, last = renderer.prepare(self.exemplars.subject(index).surface), subject
            spp = scene.spp if "noise" in differing else self.config.spp
            clean = scene.model_copy(update={"weathering": None, "spp": spp})
            twin = render_scene(self.exemplars.studio, renderer, clean, prepared)
            yield twin.image.clamp(max=BRIGHTEST).half(), twin.coverage.half()
            self.progress(1)

    def _exact(self, own: Transports | FreshRenders) -> Iterator[tuple[Tensor, Tensor]]:
        """What the exemplars' own light makes of a clean surface."""
        for index in self.chosen:
            image, coverage = own.stage([index], np.random.default_rng(0)).render(self._nothing(1))
            yield image[0], coverage[0]
            self.progress(1)

    def _gbuffers(self, own: Transports | FreshRenders) -> Float[Tensor, "exemplars height width 6"] | None:
        """What each exemplar shows."""
        if not self.config.discriminator.guide or not isinstance(own, Transports):
            return None
        return self._placed([own.gbuffer(index).half() for index in self.chosen])

    def _placed(self, found: Sequence[Tensor]) -> Tensor:
        """Each at its exemplar's place; zeros where none was chosen."""
        places = found[0].new_zeros(len(self.exemplars), *found[0].shape, device=self.device)
        places[list(self.chosen)] = torch.stack(list(found)).to(self.device)
        return places

    def _nothing(self, count: int) -> Float[Tensor, "batch rows cols channels"]:
        """Layers of alpha 0."""
        texture, maps = self.exemplars.scenes[0].texture, self.exemplars.scenes[0].maps
        return torch.zeros(count, texture, texture, layer_channels(maps), device=self.device)
