"""The stored results of a run."""

from __future__ import annotations

import math
from pathlib import Path

from pydantic import Field

from svbrdfgan.config.models import StrictModel
from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.experiments.definition import Measure
from svbrdfgan.io.records import load_record, save_record

OUTCOME = "outcome.json"


class ScorePoint(StrictModel):
    """A score on the validation split during training.

    Attributes:
        images: exemplars shown to the discriminator so far, in all its updates.
        seconds: duration of training so far.
        recovered, resemblance: the score of a run that learns one layer, or a distribution; None of the other.
    """

    images: int
    seconds: float
    recovered: float | None = None
    resemblance: float | None = None

    @property
    def score(self) -> float:
        """That by which training kept its best generator; -infinity without one."""
        found = self.recovered if self.resemblance is None else self.resemblance
        return -math.inf if found is None else found


class RunOutcome(StrictModel):
    """The contents of `outcome.json`, which is written when a run is complete.

    Attributes:
        evaluation: scores on the test split.
        history: validation scores during training, oldest first.
        jobs: number of runs that shared the device; seconds are comparable only between runs with equal `jobs`.
    """

    evaluation: Evaluation
    history: tuple[ScorePoint, ...] = Field(min_length=1)
    measures: dict[Measure, float] = {}
    device: str
    jobs: int
    versions: dict[str, str]

    @property
    def images(self) -> int:
        return self.history[-1].images

    @property
    def seconds(self) -> float:
        return self.history[-1].seconds

    def half_way(self) -> ScorePoint | None:
        """The first point with half the oracle's score; None if no point has it, or the oracle learned nothing."""
        half = self.evaluation.half_way
        return next((point for point in self.history if (point.recovered or 0.0) >= half > 0), None)

    def best_within(self, *, images: float = math.inf, seconds: float = math.inf) -> float | None:
        """The best score within a budget, which a run of that length would keep; None before the first score."""
        scores = (point.score for point in self.history if point.images <= images and point.seconds <= seconds)
        return max(scores, default=None)

    def save(self, run: Path) -> None:
        save_record(run / OUTCOME, self)

    @classmethod
    def load(cls, run: Path) -> RunOutcome:
        """Reads what `save` wrote.

        Raises:
            AssetError: the run is not complete, or the file is damaged.
            ConfigError: it is of another version.
        """
        return load_record(cls, run / OUTCOME)
