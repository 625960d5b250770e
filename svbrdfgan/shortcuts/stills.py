"""Clean pictures of both sides: unweathered, so that whatever tells them apart is a nuisance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.compositing import layer_channels
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.generate import render_scene
from svbrdfgan.protocols import Renderer
from svbrdfgan.shortcuts.nuisances import Nuisance, scenes_with
from svbrdfgan.training.config import TrainConfig
from svbrdfgan.training.feed import make_stages
from svbrdfgan.training.stages import Stage
from svbrdfgan.training.step import Shot
from svbrdfgan.transport.transfer import send

_CHUNK = 8
_HALF_LIMIT = torch.finfo(torch.half).max

Differing = frozenset[Nuisance]


@dataclass(frozen=True, eq=False)
class Stills:
    """One clean picture of each probed exemplar's scene, with what the discriminator sees beside it; half precision."""

    image: Float[Tensor, "pairs height width 3"]
    coverage: Float[Tensor, "pairs height width"]
    guide: Float[Tensor, "pairs height width 6"] | None

    @classmethod
    def of(cls, image: Tensor, coverage: Tensor, guide: Tensor | None = None) -> Stills:
        """Rounded, as stored exemplars are."""
        return cls(image.clamp(max=_HALF_LIMIT).half(), coverage.half(), None if guide is None else guide.half())

    @classmethod
    def joined(cls, stills: Sequence[Stills]) -> Stills:
        """One after another; all have guides, or none."""
        guides = [still.guide for still in stills if still.guide is not None]
        image, coverage = ([getattr(still, name) for still in stills] for name in ("image", "coverage"))
        return cls(torch.cat(image), torch.cat(coverage), torch.cat(guides) if guides else None)

    def shot(self, pairs: Sequence[int]) -> Shot:
        """Those of some pairs."""
        picked = send(torch.as_tensor(pairs), self.image.device)
        return self.image[picked], self.coverage[picked], None if self.guide is None else self.guide[picked]


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
    _made: dict[tuple[str, Differing], Stills] = field(default_factory=dict)

    def real(self, differing: Differing) -> Stills:
        """The exemplars' clean twins: their own cameras, lights and seeds."""
        return self._once("real", differing & {"noise", "renderer"}, self._real)

    def fake(self, differing: Differing) -> Stills:
        """What training would show beside them, were the generator to paint nothing."""
        return self._once("fake", differing & {"pose", "light"}, self._fake)

    def _once(self, side: str, differing: Differing, make: Callable[[Differing], Stills]) -> Stills:
        if (side, differing) not in self._made:
            self._made[side, differing] = make(differing)
        return self._made[side, differing]

    def _real(self, differing: Differing) -> Stills:
        renderer = self.made_with if "renderer" in differing else self.renderer
        stills, prepared, last = [], None, -1
        for index in self.chosen:
            subject, scene = int(self.exemplars.subject_of[index]), self.exemplars.scenes[index]
            if subject != last:
                prepared, last = renderer.prepare(self.exemplars.subject(index).surface), subject
            spp = scene.spp if "noise" in differing else self.config.spp
            clean = scene.model_copy(update={"weathering": None, "spp": spp})
            rendering = render_scene(self.exemplars.studio, renderer, clean, prepared)
            stills.append(Stills.of(rendering.image[None].to(self.device), rendering.coverage[None].to(self.device)))
            self.progress(1)
        guide = self.fake(frozenset()).guide if self.config.discriminator.guide else None
        return replace(Stills.joined(stills), guide=guide)

    def _fake(self, differing: Differing) -> Stills:
        scenes = scenes_with(self.config.scenes, differing)
        if scenes.matched:  # which training stores too, whatever its pool
            scenes = scenes.model_copy(update={"pool": 1})
        elif scenes != self.config.scenes:  # which training never sees: not to be stored
            scenes = scenes.model_copy(update={"pool": 0})
        config = self.config.model_copy(update={"scenes": scenes})
        stages = make_stages(config, self.exemplars, "train", self.renderer, self.device, self.base)
        stills = []
        for first in range(0, len(self.chosen), _CHUNK):
            indices = list(self.chosen[first : first + _CHUNK])
            stills.append(self._clean(stages.stage(indices, np.random.default_rng([config.seed, indices[0]]))))
            self.progress(len(indices))
        return Stills.joined(stills)

    def _clean(self, stage: Stage) -> Stills:
        """Under a layer of alpha 0."""
        texture, maps = self.exemplars.scenes[0].texture, self.exemplars.scenes[0].maps
        nothing = torch.zeros(len(stage.coverage), texture, texture, layer_channels(maps), device=self.device)
        with torch.no_grad():
            image = stage.render(nothing)
        return Stills.of(image, stage.coverage, stage.guide if self.config.discriminator.guide else None)
