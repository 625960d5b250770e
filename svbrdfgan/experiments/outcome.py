"""What became of one run: its verdict, and how its score rose; and the ceiling that an oracle set it."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field

from svbrdfgan.config.models import StrictModel
from svbrdfgan.evaluation.record import Evaluation, share
from svbrdfgan.experiments.definition import Measure
from svbrdfgan.io.records import load_record, save_record

OUTCOME, CEILING = "outcome.json", "ceiling.json"


class Ceiling(StrictModel):
    """The contents of `ceiling.json`: what an oracle recovered, so that runs can be judged where its weights are not.

    Attributes:
        evaluation: on the test split, of the oracle beside a run that had learned nothing.
    """

    evaluation: Evaluation

    def over(self, verdict: Evaluation) -> Evaluation:
        """The verdict on a run, with the oracle's scores put in."""
        told = ("oracle", "oracle_at_poles", "oracle_validation", "oracle_plateau", "oracle_steps", "flip_oracle")
        its = {name: getattr(self.evaluation, name) for name in told}
        return verdict.model_copy(update={**its, "fraction": share(verdict.recovered, self.evaluation.oracle)})

    def save(self, oracle: Path) -> None:
        save_record(oracle / CEILING, self)

    @classmethod
    def load(cls, oracle: Path) -> Ceiling:
        """Reads what `save` wrote.

        Raises:
            AssetError: there is no oracle yet, or the file is damaged.
            ConfigError: it is of another version.
        """
        return load_record(cls, oracle / CEILING)


class Point(StrictModel):
    """A score on the validation split, on the way.

    Attributes:
        images: exemplars shown to the discriminator so far, in all its updates.
        seconds: of training so far.
    """

    images: int
    seconds: float
    recovered: float


class Outcome(StrictModel):
    """The contents of `outcome.json`: where it is, the run is over.

    Attributes:
        evaluation: on the test split.
        history: oldest first.
        jobs: how many runs shared the device, so that seconds can be compared.
    """

    evaluation: Evaluation
    history: tuple[Point, ...] = Field(min_length=1)
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

    def half_way(self) -> Point | None:
        """Where the score first reached half the oracle's; None if it never did, or the oracle learned nothing."""
        half = (self.evaluation.oracle_validation or 0.0) / 2
        return next((point for point in self.history if point.recovered >= half > 0), None)

    def best_within(self, *, images: int) -> float | None:
        """The best score on the validation split within so many images: that of the model a shorter run had kept."""
        return max((point.recovered for point in self.history if point.images <= images), default=None)

    def best_in_time(self, *, seconds: float) -> float | None:
        """Likewise within so many seconds."""
        return max((point.recovered for point in self.history if point.seconds <= seconds), default=None)

    def save(self, run: Path) -> None:
        save_record(run / OUTCOME, self)

    @classmethod
    def load(cls, run: Path) -> Outcome:
        """Reads what `save` wrote.

        Raises:
            AssetError: the run is not over, or the file is damaged.
            ConfigError: it is of another version.
        """
        return load_record(cls, run / OUTCOME)
