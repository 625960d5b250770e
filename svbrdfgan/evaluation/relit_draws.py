"""Relit FLIP of draws: whether they look as much like true draws as these look like each other, in lights of their own.

Resemblance compares textures, map by map; pictures show the whole material at once, as far as light makes it visible.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.sampler import ConfigSampler
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.evaluation.relight import Relighter, Setting, evenly
from svbrdfgan.metrics.draw_statistics import Draws
from svbrdfgan.metrics.flip import flip
from svbrdfgan.rendering.checked_renderer import CheckedRenderer
from svbrdfgan.scene.description import Scene
from svbrdfgan.scene.loader import SceneLoader
from svbrdfgan.types import Layer

_VEHICLES = 4
_SCENES = 4  # of each vehicle


@dataclass(frozen=True, eq=False)
class DrawRelighter:
    """Compares pictures of draws in scenes that follow from a data set and a configuration alone.

    Attributes:
        scenes: a few of some subjects. Scene n has the material, amount and recipe of weathered exemplar n of the
            subject.
        loader: holds their lights.
    """

    exemplars: Exemplars
    scenes: Mapping[int, tuple[Scene, ...]]
    loader: SceneLoader
    renderer: CheckedRenderer

    @classmethod
    def make(
        cls, relighter: Relighter, exemplars: Exemplars, sampler: ConfigSampler, renderer: CheckedRenderer
    ) -> DrawRelighter:
        """Draws four scenes of each of four vehicles, or of as many as are weathered, evenly spread over the split."""
        drawn = {
            subject: tuple(scene for _, scene in relighter.scenes_of(subject, exemplars, sampler, _SCENES))
            for subject in range(len(exemplars.subjects))
        }
        weathered = [subject for subject, scenes in drawn.items() if scenes]
        chosen = [weathered[n] for n in evenly(len(weathered), _VEHICLES)]
        return cls(exemplars, {subject: drawn[subject] for subject in chosen}, relighter.loader, renderer)

    def flips(self, subject: int, truth: Draws, others: Mapping[Painter, Draws]) -> dict[Painter, list[float]]:
        """FLIP between true draws of a subject and others, draw n in scene n; empty for subjects without scenes.

        All pictures of a scene have the same random numbers, so that equal draws have no difference.

        Args:
            truth: true draws, in the order of the subject's weathered exemplars, whose amounts and recipes they have.
            others: likewise, of each painter.
        """
        found = defaultdict[Painter, list[float]](list)
        if subject not in self.scenes:
            return found
        shown = self.exemplars.subjects[subject]
        prepared = self.renderer.prepare(shown.surface)
        for number, scene in enumerate(self.scenes[subject][: len(truth.values)]):
            setting = Setting(scene, self.loader.view(scene), shown, self.renderer, prepared)
            reference, _ = setting.picture(Layer(truth.values[number], truth.maps), scene.seed)
            for painter, draws in others.items():
                picture, _ = setting.picture(Layer(draws.values[number], draws.maps), scene.seed)
                found[painter].append(flip(reference, picture))
        return found
