"""The history of a run: when it was half way, and its best score within a budget."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.record import MapScore
from svbrdfgan.experiments.columns import verdicts
from svbrdfgan.experiments.outcome import RunOutcome
from svbrdfgan.metrics.draw_figures import AmountFigures, DrawFigures, RelitFigures
from svbrdfgan.metrics.draw_statistics import PARTS
from svbrdfgan.metrics.resemblance import Resemblance

DRAWS = Resemblance(**dict.fromkeys(PARTS, 0.5) | {"joint": 0.25}, subjects=2, draws=16)
FIGURES = DrawFigures(
    deviation=0.8,
    mean_correlation=0.7,
    power=(0.4, 0.9, 1.3),
    relief=(0.7, 1.5, 1.0),
    amount=AmountFigures(correlation=0.95, error=0.05),
    relit=RelitFigures(flip=0.06, of_truth=0.05, pairs=16),
)


def changed(outcome: RunOutcome, **scores: dict[str, Any]) -> RunOutcome:
    """The outcome with other scores, by painter."""
    before = outcome.evaluation
    update = {painter: before.painters[painter].model_copy(update=each) for painter, each in scores.items()}
    return outcome.model_copy(update={"evaluation": before.model_copy(update=update)})


def test_it_is_read_as_written(outcome, tmp_path: Path) -> None:
    outcome().save(tmp_path)
    assert RunOutcome.load(tmp_path) == outcome()
    with pytest.raises(AssetError):
        RunOutcome.load(tmp_path / "elsewhere")


def test_half_way_is_where_the_score_first_reached_half_the_oracle(outcome) -> None:
    found = outcome(oracle=0.9).half_way()
    assert found is not None
    assert (found.images, found.seconds) == (200, 20.0)
    assert outcome(oracle=0.4).half_way().images == 100  # exactly half counts
    assert outcome(oracle=1.2).half_way() is None
    assert outcome(oracle=-0.1).half_way() is None  # an oracle that learned nothing is no yardstick


@pytest.mark.parametrize(("images", "score"), [(99, None), (100, 0.2), (199, 0.2), (200, 0.5), (300, 0.5)])
def test_within_a_budget_the_best_counts(outcome, images: int, score: float | None) -> None:
    assert outcome().best_within(images=images) == score
    assert outcome().best_within(seconds=images / 10) == score


def test_what_it_took_is_the_end_of_its_history(outcome) -> None:
    assert (outcome().images, outcome().seconds) == (300, 30.0)


def test_maps_and_relit_pictures_have_columns_where_there_are_any(outcome) -> None:
    assert not {"relit_flip", "relit_ratio"} & {column.key for column in verdicts((), [outcome()])}
    maps = {"base_color": MapScore(recovered=0.6), "roughness": MapScore(recovered=0.4), "metallic": MapScore(error=0)}
    glossy = changed(
        outcome(),
        generated={"maps": maps, "relit_flip": 0.3},
        oracle={"maps": {"roughness": MapScore(recovered=0.8)}, "relit_flip": 0.2},
    )
    columns = {column.key: column.over([glossy]) for column in verdicts((), [outcome(), glossy])}
    further = {key: value.mean for key, value in columns.items() if value is not None and key not in ("recovered",)}
    wanted = {"recovered_roughness": 0.4, "fraction_roughness": 0.5, "relit_flip": 0.3, "relit_ratio": 1.5}
    assert {key: further.get(key) for key in wanted} == pytest.approx(wanted)
    assert not {"recovered_base_color", "recovered_metallic"} & columns.keys()


def test_draws_have_columns_where_there_are_any(outcome) -> None:
    assert not any("resemblance" in column.key for column in verdicts((), [outcome()]))
    best = DRAWS.model_copy(update={"joint": 0.5})
    outcomes = [changed(outcome(), generated={"draws": DRAWS, "figures": FIGURES}, oracle={"draws": best})]
    columns = {column.key: column.over(outcomes) for column in verdicts((), outcomes)}
    numbers = {key: value.mean for key, value in columns.items() if value is not None}
    wanted = {
        "resemblance": DRAWS.resemblance, "resemblance_least": 0.25, "resemblance_oracle": 0.5,
        "resemblance_fraction": DRAWS.resemblance / 0.5,
        "resemblance_joint": 0.25, "resemblance_mean": 0.5, "deviation_ratio": 0.8, "mean_correlation": 0.7,
        "power_least": 0.4, "power_greatest": 1.3, "amount_correlation": 0.95, "amount_error": 0.05,
        "relief_least": 0.7, "relief_greatest": 1.5, "relit_of_truth": 1.2,
    }  # fmt: skip
    assert {key: numbers.get(key) for key in wanted} == pytest.approx(wanted)
    octaves = [column for column in verdicts(["octaves"], outcomes) if column.key[-1].isdigit()]
    assert [column.key for column in octaves] == [
        *(f"power_{n}" for n in range(1, 1 + len(FIGURES.power))),
        *(f"relief_{n}" for n in range(1, 1 + len(FIGURES.relief))),
    ]
    assert [column.value(outcomes[0]) for column in octaves] == [*FIGURES.power, *FIGURES.relief]
