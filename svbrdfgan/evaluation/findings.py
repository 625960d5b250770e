"""The scores of each painter, from what was measured of its layers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from svbrdfgan.data.config import Split
from svbrdfgan.evaluation.distribution import Comparison
from svbrdfgan.evaluation.oracle import Oracle
from svbrdfgan.evaluation.record import (
    ConstantScores,
    Evaluation,
    LearnedScores,
    MapScore,
    OracleScores,
    Painter,
    PainterScores,
)
from svbrdfgan.metrics.recovered import Scorer
from svbrdfgan.types import RGBA


@dataclass(frozen=True, eq=False)
class Findings:
    """Everything that was measured on a split.

    Attributes:
        constants: for each map, base_color first, the best constant layer.
        layers: the layers of each subject, of all painters but the truth.
        flips: mean FLIP between pictures under the layers and the exemplars.
        relit_flips: likewise in new scenes; empty if no picture was relit.
    """

    scorer: Scorer
    constants: Float[Tensor, "maps channels"]
    layers: Mapping[Painter, Float[Tensor, "subjects rows cols channels"]]
    flips: Mapping[Painter, float]
    relit_flips: Mapping[Painter, float]
    draws: Comparison

    def evaluation(self, split: Split, oracle: Oracle | None) -> Evaluation:
        """The scores of all painters."""
        return Evaluation(
            split=split,
            subjects=len(self.scorer.inputs),
            exemplars=len(self.scorer.targets),
            areas=self.scorer.shares,
            generated=self._learned("generated"),
            oracle=None
            if oracle is None
            else OracleScores(
                **dict(self._learned("oracle")), steps=oracle.steps, plateau=oracle.plateau, validation=oracle.score
            ),
            constant=self._constant(),
            truth=self._pictured("truth"),
            refusal=self.draws.refusal,
        )

    def _pictured(self, painter: Painter) -> PainterScores:
        relit = self.relit_flips.get(painter)
        return PainterScores(flip=self.flips[painter], relit_flip=relit, figures=self.draws.figures.get(painter))

    def _constant(self) -> ConstantScores:
        red, green, blue, alpha = self.constants[0, :RGBA].tolist()
        errors = {name: _known(error) for name, error in self.scorer.constant_errors.items()}
        return ConstantScores(**dict(self._pictured("constant")), layer=(red, green, blue, alpha), errors=errors)

    def _learned(self, painter: Painter) -> LearnedScores:
        layers, ends = self.layers[painter], self.scorer.at_poles(self.constants)
        return LearnedScores(
            **dict(self._pictured(painter)),
            recovered=self.scorer.recovered_by(layers),
            recovered_at_poles=ends.recovered_by(layers) if ends else None,
            maps=self._maps(layers) if len(self.scorer.constant_errors) > 1 else {},
            draws=self.draws.resemblance.get(painter),
        )

    def _maps(self, layers: Float[Tensor, "subjects rows cols channels"]) -> dict[str, MapScore]:
        recovered, errors = self.scorer.each_recovered_by(layers), self.scorer.errors_by(layers)
        return {name: MapScore(recovered=recovered[name], error=_known(errors[name])) for name in recovered}


def _known(error: float) -> float | None:
    """None for the error of a map that can be observed nowhere, since JSON has no NaN."""
    return None if math.isnan(error) else error
