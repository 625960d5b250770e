"""Scores on the validation split during training, by which the best generator is kept."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.constant_layer import constant_layers
from svbrdfgan.metrics.draw_scorer import DrawScorer
from svbrdfgan.metrics.recovered import Scorer, SeenTexels, mean_over_maps
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.training.resolve import ResolvedRun, learns_distribution

Measure = Literal["recovered", "resemblance"]
"""The name of a score."""

_DRAWS, _VEHICLES = 8, 8
"""Draws of each vehicle in each set, and vehicles: half of what an evaluation compares, so that scores take seconds."""

log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Validation:
    """The subjects of the validation split, and how generators are scored on them.

    A generator that learns one layer is scored by what it `recovered`, on all texels that pictures show: to find where
    each further map can be observed would take renderings of the whole split. One that learns a distribution is scored
    by the `resemblance` of its draws: one draw recovers no other, however alike they look.

    Attributes:
        typical: the labels of the layer that stands for a generator, the one of seed 0.
        measure: the name of the score; None where true draws cannot be compared, so that the last generator is kept.
        draws: scores `resemblance`.
    """

    fabric: Fabric
    scorer: Scorer
    typical: Sequence[float]
    measure: Measure | None
    draws: DrawScorer | None

    @classmethod
    def make(
        cls,
        fabric: Fabric,
        run: ResolvedRun,
        train: tuple[Exemplars, SeenTexels],
        held_out: tuple[Exemplars, SeenTexels],
    ) -> Validation:
        """A scorer of the held-out split, against the constant layers of the training subjects.

        Raises:
            AssetError: nothing of the split can be scored.
        """
        constants = constant_layers(*train, fabric.device)
        scorer = Scorer.make(*held_out, constants, fabric.device)
        measure: Measure | None = None
        declared, draws = run.dataset.config.weathering, None
        if declared is None or not learns_distribution(run.config.generator, run.dataset.config):
            measure = "recovered"
        else:
            try:
                draws = DrawScorer.make(
                    held_out[0], scorer, constants, declared, run.conditions, count=_DRAWS, limit=_VEHICLES
                )
                measure = "resemblance"
            except AssetError as error:
                log.warning("draws have no score, so the last generator is kept: %s", error)
        return cls(fabric, scorer, run.conditions.typical(), measure, draws)

    def score(self, generator: Generator) -> dict[str, float]:
        """The score, under the name of `measure`, and what it is made of, by map or by part; empty without one.

        `rank`, if it is there, chooses the best generator in the score's place.
        """
        if self.draws is not None:
            found = self.draws.score(generator, self.fabric)
            parts = {f"resemblance_{name}": value for name, value in found.parts.items()}
            return {"resemblance": found.resemblance, "rank": found.rank} | parts
        if self.measure is None:
            return {}
        each = self.scorer.each_recovered_by(self._layers(generator))
        by_map = {f"recovered_{name}": value for name, value in each.items() if value is not None and len(each) > 1}
        return {"recovered": mean_over_maps(each)} | by_map

    def picture(self, generator: Generator) -> Float[Tensor, "height width 3"]:
        """The layer of seed 0 on the first subjects, above true ones; sRGB, v upwards."""
        return self.scorer.picture(self._layers(generator))

    def _layers(self, generator: Generator) -> Float[Tensor, "subjects rows cols channels"]:
        with self.fabric.autocast():
            return self.scorer.layers(Draw(generator, labels=self.typical).on)
