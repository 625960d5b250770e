"""The columns of the table: the meaning of each number, and its mean and standard deviation over the seeds."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from svbrdfgan.experiments.definition import Measure
from svbrdfgan.experiments.outcome import RunOutcome
from svbrdfgan.metrics.draw_figures import DrawFigures
from svbrdfgan.metrics.draw_statistics import PARTS


@dataclass(frozen=True)
class Statistic:
    """A number over seeds.

    Attributes:
        deviation: sample standard deviation; None for fewer than two values.
        count: number of runs that have the number.
        of: number of all runs.
    """

    mean: float
    deviation: float | None
    count: int
    of: int


@dataclass(frozen=True)
class Column:
    """A number that outcomes may have. `absent` is printed if no outcome has it; `form` is its format specification."""

    key: str
    heading: str
    meaning: str
    value: Callable[[RunOutcome], float | None]
    form: str = ".3f"
    absent: str = ""

    def over(self, outcomes: Sequence[RunOutcome]) -> Statistic | None:
        """The number over the outcomes; None if no outcome has it."""
        values = [value for value in map(self.value, outcomes) if value is not None]
        if not values:
            return None
        deviation = statistics.stdev(values) if len(values) > 1 else None
        return Statistic(statistics.fmean(values), deviation, len(values), len(outcomes))


def _of_part(name: str) -> Column:
    """A part of resemblance."""
    return Column(
        f"resemblance_{name}",
        name,
        f"the part `{name}` of resemblance",
        lambda outcome: None if (draws := outcome.evaluation.generated.draws) is None else draws.parts[name],
        ".2f",
    )


def _of_draws(
    key: str, heading: str, meaning: str, value: Callable[[DrawFigures], float | None], form: str = ".2f"
) -> Column:
    """A figure of a run's own draws."""
    return Column(
        key,
        heading,
        meaning,
        lambda outcome: None if (found := outcome.evaluation.generated.figures) is None else value(found),
        form,
    )


_VERDICTS = (
    Column(
        "recovered",
        "recovered",
        "how much of the true layers was learned, on test vehicles: 1 is all, 0 no better than one colour everywhere",
        lambda outcome: outcome.evaluation.generated.recovered,
    ),
    Column(
        "oracle",
        "oracle",
        "`recovered` of the same network trained on the true layers of the same data: the ceiling",
        lambda outcome: None if (best := outcome.evaluation.oracle) is None else best.recovered,
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
        lambda outcome: outcome.evaluation.generated.flip,
    ),
    Column(
        "seen",
        "seen",
        "share of the learnable area that some test picture shows; only that is scored",
        lambda outcome: outcome.evaluation.seen,
        ".0%",
    ),
)

_RELIT = (
    Column(
        "relit_flip",
        "relit FLIP",
        "how different pictures look under the learned layers in new lights and from new views: 0 is no difference",
        lambda outcome: outcome.evaluation.generated.relit_flip,
    ),
    Column(
        "relit_ratio",
        "relit FLIP / oracle's",
        "relit FLIP over that of the oracle",
        lambda outcome: outcome.evaluation.relit_ratio,
        ".2f",
    ),
)

_RESEMBLANCE = (
    Column(
        "resemblance",
        "resemblance",
        "how alike draws on test vehicles are to true draws: 1 is as alike as true draws are to each other, 0 is one "
        "colour everywhere; then `recovered` is that of one draw, and says little",
        lambda outcome: outcome.evaluation.generated.resemblance,
    ),
    Column(
        "resemblance_least",
        "least part",
        "the least of the parts of resemblance",
        lambda outcome: None if (draws := outcome.evaluation.generated.draws) is None else draws.parts[draws.least],
        ".2f",
    ),
    Column(
        "resemblance_oracle",
        "resemblance of the oracle",
        "of the same network trained adversarially on true layers instead of pictures",
        lambda outcome: None if (best := outcome.evaluation.oracle) is None else best.resemblance,
    ),
    Column(
        "resemblance_fraction",
        "resemblance, of the oracle",
        "resemblance / that of the oracle",
        lambda outcome: outcome.evaluation.resemblance_fraction,
        ".2f",
    ),
    *(_of_part(name) for name in PARTS),
    _of_draws(
        "deviation_ratio",
        "deviation / truth",
        "standard deviation of alpha over draws, mean over the surface, over that of true draws",
        lambda figures: figures.deviation,
    ),
    _of_draws(
        "mean_correlation",
        "mean maps correlate",
        "correlation over the surface of the maps of mean alpha with the true ones, the mean over vehicles",
        lambda figures: figures.mean_correlation,
    ),
    _of_draws(
        "power_least",
        "least power / truth",
        "power of alpha over that of true draws, in the octave where it is least",
        lambda figures: min(figures.power),
    ),
    _of_draws(
        "power_greatest",
        "greatest power / truth",
        "likewise where it is greatest",
        lambda figures: max(figures.power),
    ),
    _of_draws(
        "relief_least",
        "least relief / truth",
        "power of the slopes of normals over that of true draws, in the octave where it is least",
        lambda figures: min(figures.relief, default=None),
    ),
    _of_draws(
        "relief_greatest",
        "greatest relief / truth",
        "likewise where it is greatest",
        lambda figures: max(figures.relief, default=None),
    ),
    _of_draws(
        "relit_of_truth",
        "relit FLIP / between true draws",
        "FLIP between relit pictures of a true draw and a learned one, over that between two true draws",
        lambda figures: None if figures.relit is None else figures.relit.ratio,
    ),
    _of_draws(
        "amount_correlation",
        "amount, rank correlation",
        "rank correlation, over amounts, of mean alpha over the learnable area with the recipe's",
        lambda figures: None if figures.amount is None else figures.amount.correlation,
    ),
    _of_draws(
        "amount_error",
        "amount, error",
        "mean absolute difference between the two at the same amount",
        lambda figures: None if figures.amount is None else figures.amount.error,
        ".3f",
    ),
)

_MEASURES: dict[Measure, Column] = {
    "shown": Column(
        "shown",
        "recovered, shown",
        "`recovered` on the part of the learnable area that the training's cameras would see",
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
        "variance, over samples, of the gradient of a picture's error with respect to the layer, relative to the "
        "squared gradient",
        lambda outcome: outcome.measures.get("gradient_noise"),
        ".3g",
    ),
}

OF_ORACLE = frozenset({"oracle", "fraction", "half_images", "half_seconds"})
"""Keys of columns that are empty without an oracle."""
_MOST_OCTAVES = 8


def _of_octave(kind: str, what: str, of: Callable[[DrawFigures], tuple[float, ...]], number: int) -> Column:
    def value(figures: DrawFigures) -> float | None:
        ratios = of(figures)
        return ratios[number] if number < len(ratios) else None

    meaning = f"{what} over that of true draws, in octave {number + 1} of the texture, of which 1 is the finest"
    return _of_draws(f"{kind}_{number + 1}", f"{kind} {number + 1}", meaning, value)


_OCTAVES = (
    *(_of_octave("power", "power of alpha", lambda figures: figures.power, n) for n in range(_MOST_OCTAVES)),
    *(
        _of_octave("relief", "power of normals' slopes", lambda figures: figures.relief, n)
        for n in range(_MOST_OCTAVES)
    ),
)


def verdicts(measures: Sequence[Measure], outcomes: Sequence[RunOutcome] = ()) -> list[Column]:
    """Columns for the quality of the learned layers. Of maps, relit pictures and draws, what some outcome has."""
    names = dict.fromkeys(name for o in outcomes for name in o.evaluation.generated.maps if name != "base_color")
    octaves = _OCTAVES if "octaves" in measures else ()
    optional = [*(column for name in names for column in _of_map(name)), *_RELIT, *_RESEMBLANCE, *octaves]
    known = [column for column in optional if column.over(outcomes) is not None]
    return [*_VERDICTS, *known, *(_MEASURES[name] for name in measures if name in _MEASURES)]


def _of_map(name: str) -> tuple[Column, ...]:
    """Columns for what was recovered of a further map, and for its share of the oracle's."""

    return (
        Column(
            f"recovered_{name}",
            f"{name} recovered",
            f"`recovered` of {name}, where it can be observed",
            lambda outcome: outcome.evaluation.generated.of_map(name).recovered,
        ),
        Column(
            f"fraction_{name}",
            f"{name} of the oracle",
            f"`recovered` / oracle of {name}",
            lambda outcome: outcome.evaluation.of_oracle(lambda its: its.of_map(name).recovered),
            ".2f",
        ),
    )


def speeds(images: int, seconds: float) -> list[Column]:
    """Columns for the speed of training. Every run saw at least `images` and trained for at least `seconds`."""
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
            "of training until the validation score reached half the oracle's",
            lambda outcome: None if (half := outcome.half_way()) is None else half.seconds,
            ",.0f",
            "never",
        ),
        Column(
            "at_images",
            f"at {images:,} images",
            "the best validation score within as many images as every run saw",
            lambda outcome: outcome.best_within(images=images),
            absent="no score yet",
        ),
        Column(
            "at_seconds",
            f"at {seconds:,.0f} s",
            "the best validation score within as many seconds as every run trained",
            lambda outcome: outcome.best_within(seconds=seconds),
            absent="no score yet",
        ),
    ]
