"""The numbers of a distribution, with their meaning in words: how alike draws are to true ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from svbrdfgan.evaluation.record import Evaluation, OracleScores
from svbrdfgan.metrics.draw_figures import DrawFigures
from svbrdfgan.metrics.resemblance import PART_MEANINGS
from svbrdfgan.report.facts import KeyFigure


@dataclass(frozen=True)
class PartBar:
    """A part of `resemblance` as a bar from 0 to 1.

    Attributes:
        percent: the bar's length.
        oracle: place of the oracle's part on the bar in percent; None where the oracle has none.
    """

    label: str
    value: str
    meaning: str
    percent: float
    oracle: float | None


def draw_verdict(evaluation: Evaluation) -> list[KeyFigure]:
    """The figures at the head of the page of a distribution; unknown ones are left out."""
    return [
        *_resemblances(evaluation),
        *_figures(evaluation.generated.figures),
        KeyFigure(
            "area seen",
            f"{evaluation.seen:.0%}",
            "The share of the learnable area that some picture shows; only that is compared.",
        ),
    ]


def part_bars(evaluation: Evaluation) -> list[PartBar]:
    """The parts of the generator's resemblance beside the oracle's; none if draws could not be compared."""
    mine, best = evaluation.generated.draws, None if evaluation.oracle is None else evaluation.oracle.draws
    if mine is None:
        return []
    oracle = {} if best is None else {name: _percent(value) for name, value in best.parts.items()}
    return [
        PartBar(name, f"{value:.2f}", PART_MEANINGS[name], _percent(value), oracle.get(name))
        for name, value in mine.parts.items()
    ]


def _resemblances(evaluation: Evaluation) -> Iterator[KeyFigure]:
    mine, oracle = evaluation.generated.draws, evaluation.oracle
    if mine is not None:
        yield KeyFigure(
            "resemblance",
            f"{mine.resemblance:.3f}",
            "How alike the generator's draws are to true ones: 1 is as alike as true draws are to each other, 0 is one "
            "colour everywhere.",
        )
        yield KeyFigure(
            f"least part: {mine.least}",
            f"{mine.parts[mine.least]:.2f}",
            f"What resembles the truth least: {PART_MEANINGS[mine.least]}.",
        )
    if oracle is not None and oracle.draws is not None:
        meaning = _oracle_meaning(oracle, evaluation.resemblance_fraction)
        yield KeyFigure("resemblance of the oracle", f"{oracle.draws.resemblance:.3f}", meaning)


def _figures(figures: DrawFigures | None) -> Iterator[KeyFigure]:
    if figures is None:
        return
    yield KeyFigure(
        "deviation over draws",
        f"{figures.deviation:.2f}",
        "How much draws differ from each other, over how much true draws do: 1 is as varied, 0 is the same layer at "
        "every seed.",
    )
    if figures.relit is not None:
        yield KeyFigure(
            "relit FLIP, of true draws'",
            f"{figures.relit.ratio:.2f}",
            "How different pictures of a learned and a true draw are, in new lights and from new views, over how "
            "different those of two true draws are: 1 is as alike.",
        )
    if figures.relief:
        yield KeyFigure(
            "relief, least and most",
            f"{min(figures.relief):.2f}, {max(figures.relief):.2f}",
            "The power of the slopes of normals over that of true ones, at the size of pattern where it is least and "
            "where it is greatest: 1 is as strong.",
        )
    if figures.amount is not None:
        yield KeyFigure(
            "amount, rank",
            f"{figures.amount.correlation:.2f}",
            "Whether a greater amount covers more: 1 is always, 0 is by chance.",
        )
        yield KeyFigure(
            "amount, error",
            f"{figures.amount.error:.3f}",
            "How far the covered share of the surface is from the true one at the same amount: 0 is not at all.",
        )


def _oracle_meaning(oracle: OracleScores, fraction: float | None) -> str:
    reached = "" if fraction is None else f"; this run reaches {fraction:.0%} of it"
    return f"The same network after {oracle.steps:,} steps on true layers instead of pictures{reached}."


def _percent(value: float) -> float:
    return 100 * min(max(value, 0.0), 1.0)
