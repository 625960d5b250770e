"""The texels where each further map of a split can be observed: their true values matter to its pictures.

The masks come from the truth, the split's scenes and the renderer alone, so that they are the same for every generator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.io.image import luminance
from svbrdfgan.metrics.map_errors import tilted
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.training.scene_batch import seen_in_gradient
from svbrdfgan.types import Material, Materials

CHANGE = 0.1
"""The change of a map whose values are in [0, 1]."""
DEGREES = 10.0
"""The tilt of a normal."""
VISIBLE = 0.02
"""The share of its luminance by which a pixel must change."""

_SAMPLES = 4
"""Samples per pixel, in those of the exemplars: of 64, noise alone passes for a change in pixels of small lights."""


@dataclass(frozen=True, eq=False)
class Observation:
    """Finds the texels where a subject's maps can be observed.

    A texel counts for a map if some picture of its subject has a pixel that shows it and that changes by over 2 % when
    the true map changes everywhere by 0.1, towards the inside of [0, 1], or when the true normals tilt by 10 degrees,
    in either of two perpendicular directions. Both pictures have the same random numbers.
    """

    exemplars: Exemplars
    renderer: CheckedRenderer
    progress: Callable[[int], None]

    def __call__(self, subject: int) -> dict[str, Bool[Tensor, "rows cols"]]:
        """The texels where each further map can be observed in pictures of that subject."""
        views = list(filter(self.exemplars.weathered, self.exemplars.views_of(subject)))
        prepared = self.renderer.prepare(self.exemplars.subjects[subject].surface)
        found: dict[str, Tensor] = {}
        for index in views:
            for name, texels in self._of_view(index, prepared).items():
                found[name] = found[name] | texels if name in found else texels
            self.progress(1)
        return found

    def _of_view(self, index: int, prepared: Any) -> dict[str, Bool[Tensor, "rows cols"]]:
        exemplars, scene = self.exemplars, self.exemplars.scenes[index]
        spp = _SAMPLES * scene.spp
        subject, view = exemplars.subject(index), exemplars.loader.view(scene)
        true = subject.materials(exemplars.layers[index], scene.maps, base_colors=scene.materials)

        def brightness(materials: Materials) -> Tensor:
            picture = self.renderer.render(prepared, materials, view, spp=spp, seed=scene.seed)
            return luminance(picture.image.cpu())

        found, before = {}, brightness(true)
        for name in scene.maps:
            changed = torch.zeros_like(before, dtype=torch.bool)
            for materials in _changes(true, name, subject.learnable):
                changed |= (brightness(materials) - before).abs() > VISIBLE * before
            found[name] = seen_in_gradient(exemplars, index, self.renderer, prepared, spp, changed) > 0
        return found


def _changes(materials: Materials, name: str, learnable: tuple[int, ...]) -> Iterator[Materials]:
    """The materials with one map of the learnable parts changed, in each of its ways."""
    for way in range(2 if name == "normal" else 1):
        parts = list(materials.parts)
        for part in learnable:
            maps = parts[part].maps
            parts[part] = Material({**maps, name: _changed(name, maps[name])[way]})
        yield Materials(tuple(parts))


def _changed(name: str, values: Tensor) -> tuple[Tensor, ...]:
    if name == "normal":
        return tilted(values, DEGREES)
    return (torch.where(values < 0.5, values + CHANGE, values - CHANGE),)
