"""The numbers of the table: what each is, and what it comes to over the seeds."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from svbrdfgan.experiments.definition import Measure
from svbrdfgan.experiments.outcome import Outcome


@dataclass(frozen=True)
class Statistic:
    """A number over seeds.

    Attributes:
        deviation: the sample's; None for fewer than two.
        count, of: how many runs have the number, of how many.
    """

    mean: float
    deviation: float | None
    count: int
    of: int


@dataclass(frozen=True)
class Column:
    """A number that every outcome has, or may have; `absent` stands where none has it."""

    key: str
    heading: str
    meaning: str
    value: Callable[[Outcome], float | None]
    form: str = ".3f"
    absent: str = ""

    def over(self, outcomes: Sequence[Outcome]) -> Statistic | None:
        """None if no outcome has the number."""
        values = [value for value in map(self.value, outcomes) if value is not None]
        if not values:
            return None
        deviation = statistics.stdev(values) if len(values) > 1 else None
        return Statistic(statistics.fmean(values), deviation, len(values), len(outcomes))


_VERDICTS = (
    Column(
        "recovered",
        "recovered",
        "how much of the true layers was learned, on test vehicles: 1 is all, 0 no better than one colour everywhere",
        lambda outcome: outcome.evaluation.recovered,
    ),
    Column(
        "oracle",
        "oracle",
        "`recovered` of the same network on the same data, told the truth: the ceiling",
        lambda outcome: outcome.evaluation.oracle,
    ),
    Column(
        "fraction",
        "of the oracle",
        "`recovered` / oracle",
        lambda outcome: outcome.evaluation.fraction,
        ".2f",
    ),
    Column(
        "flip",
        "FLIP",
        "how different test pictures look under the learned layers: 0 is no difference",
        lambda outcome: outcome.evaluation.flip,
    ),
    Column(
        "seen",
        "seen",
        "share of the learnable area that some test picture shows; only that is scored",
        lambda outcome: outcome.evaluation.seen,
        ".0%",
    ),
)

_MEASURES: dict[Measure, Column] = {
    "shown": Column(
        "shown",
        "recovered, shown",
        "`recovered` on that part of the learnable area that pictures taken from where the training's were would show",
        lambda outcome: outcome.measures.get("shown"),
    ),
    "unseen": Column(
        "unseen",
        "recovered, unseen",
        "`recovered` on the rest of the learnable area",
        lambda outcome: outcome.measures.get("unseen"),
    ),
    "gradient_noise": Column(
        "gradient_noise",
        "gradient noise",
        "variance over samples of the gradient of a picture's error in the layer, relative to the squared gradient",
        lambda outcome: outcome.measures.get("gradient_noise"),
        ".3g",
    ),
}


def verdicts(measures: Sequence[Measure]) -> list[Column]:
    """How well was learned."""
    return [*_VERDICTS, *(_MEASURES[name] for name in measures)]


def speeds(images: int, seconds: float) -> list[Column]:
    """How fast was learned; `images` and `seconds` are what every run saw and trained for, at least."""
    return [
        Column(
            "images",
            "images",
            "exemplars shown to the discriminator, in all its updates",
            lambda outcome: float(outcome.images),
            ",.0f",
        ),
        Column("seconds", "seconds", "of training", lambda outcome: outcome.seconds, ",.0f"),
        Column(
            "half_images",
            "images to half",
            "until the validation score reached half the oracle's",
            lambda outcome: None if (half := outcome.half_way()) is None else float(half.images),
            ",.0f",
            "never",
        ),
        Column(
            "half_seconds",
            "seconds to half",
            "likewise",
            lambda outcome: None if (half := outcome.half_way()) is None else half.seconds,
            ",.0f",
            "never",
        ),
        Column(
            "at_images",
            f"at {images:,} images",
            "the best validation score by then: as many images as every run saw at least",
            lambda outcome: outcome.best_within(images=images),
            absent="no score yet",
        ),
        Column(
            "at_seconds",
            f"at {seconds:,.0f} s",
            "the best validation score by then: as long as every run trained at least",
            lambda outcome: outcome.best_in_time(seconds=seconds),
            absent="no score yet",
        ),
    ]
