"""The history of a run: when it was half way, and its best score within a budget."""

from __future__ import annotations

from pathlib import Path

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.evaluation.record import MapScore
from svbrdfgan.experiments.columns import verdicts
from svbrdfgan.experiments.outcome import Ceiling, RunOutcome
from svbrdfgan.metrics.draw_figures import AmountFigures, DrawFigures
from svbrdfgan.metrics.draw_statistics import PARTS
from svbrdfgan.metrics.resemblance import Resemblance

DRAWS = Resemblance(**dict.fromkeys(PARTS, 0.5) | {"joint": 0.25}, subjects=2, draws=16)
FIGURES = DrawFigures(
    deviation=0.8, mean_correlation=0.7, power=(0.4, 0.9, 1.3), amount=AmountFigures(correlation=0.95, error=0.05)
)


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


def test_a_ceiling_is_put_over_a_verdict(outcome, tmp_path: Path) -> None:
    """The oracle's scores come from the ceiling, all others stay."""
    Ceiling(evaluation=outcome(0.0, oracle=0.9, plateau=False).evaluation).save(tmp_path)
    verdict = outcome(0.45, oracle=0.5).evaluation
    lacking = ("oracle", "fraction", "oracle_validation", "oracle_plateau", "flip_oracle")
    alone = verdict.model_copy(update=dict.fromkeys(lacking))
    over = Ceiling.load(tmp_path).over(alone)
    assert (over.recovered, over.oracle, over.fraction) == (0.45, 0.9, pytest.approx(0.5))
    assert (over.oracle_validation, over.oracle_plateau) == (0.9, False)
    assert (over.flip, over.flip_oracle, over.oracle_steps) == (verdict.flip, 0.05, 300)
    with pytest.raises(AssetError):
        Ceiling.load(tmp_path / "elsewhere")


def test_a_ceiling_is_put_over_each_map(outcome) -> None:
    relit = {"relit_flip": 0.3, "relit_flip_oracle": 0.2}
    its = {"maps": {"roughness": MapScore(recovered=0.0, oracle=0.8)}, "relit_flip_oracle": 0.15}
    ceiling = Ceiling(evaluation=outcome().evaluation.model_copy(update=its))
    own = {"roughness": MapScore(recovered=0.4, area=0.7), "metallic": MapScore(recovered=0.3)}
    over = ceiling.over(outcome().evaluation.model_copy(update={"maps": own, **relit}))
    assert over.maps["roughness"] == MapScore(recovered=0.4, oracle=0.8, fraction=0.5, area=0.7)
    assert over.maps["metallic"] == MapScore(recovered=0.3)
    assert over.relit_ratio == pytest.approx(2.0)


def test_maps_and_relit_pictures_have_columns_where_there_are_any(outcome) -> None:
    assert not {"relit_flip", "relit_ratio"} & {column.key for column in verdicts((), [outcome()])}
    found = outcome()
    maps = {"base_color": MapScore(recovered=0.6), "roughness": MapScore(recovered=0.4, fraction=0.5)}
    update = {"maps": maps | {"metallic": MapScore(error=0.0)}, "relit_flip": 0.3, "relit_flip_oracle": 0.2}
    glossy = found.model_copy(update={"evaluation": found.evaluation.model_copy(update=update)})
    columns = {column.key: column.over([glossy]) for column in verdicts((), [outcome(), glossy])}
    further = {key: value.mean for key, value in columns.items() if value is not None and key not in ("recovered",)}
    wanted = {"recovered_roughness": 0.4, "fraction_roughness": 0.5, "relit_flip": 0.3, "relit_ratio": 1.5}
    assert {key: further.get(key) for key in wanted} == pytest.approx(wanted)
    assert not {"recovered_base_color", "recovered_metallic"} & columns.keys()


def test_the_ceiling_of_a_distribution_is_that_of_resemblance(outcome) -> None:
    """`recovered` of one draw is no yardstick for another."""
    its = {"oracle_plateau": None, "resemblance_oracle": 0.8, "draws_oracle": DRAWS, "figures": {"oracle": FIGURES}}
    ceiling = Ceiling(evaluation=outcome().evaluation.model_copy(update=its))
    own = {"resemblance": 0.6, "draws": DRAWS, "figures": {"generated": FIGURES}}
    over = ceiling.over(outcome().evaluation.model_copy(update=own))
    assert over.fraction is None
    assert over.resemblance_fraction == pytest.approx(0.75)
    assert (over.resemblance_oracle, over.draws_oracle) == (0.8, DRAWS)
    assert over.figures == {"generated": FIGURES, "oracle": FIGURES}


def test_draws_have_columns_where_there_are_any(outcome) -> None:
    assert not any("resemblance" in column.key for column in verdicts((), [outcome()]))
    found = outcome()
    update = {"resemblance": 0.6, "resemblance_oracle": 0.8, "resemblance_fraction": 0.75, "draws": DRAWS}
    varied = found.evaluation.model_copy(update=update | {"figures": {"generated": FIGURES}})
    outcomes = [found.model_copy(update={"evaluation": varied})]
    columns = {column.key: column.over(outcomes) for column in verdicts((), outcomes)}
    numbers = {key: value.mean for key, value in columns.items() if value is not None}
    wanted = {
        "resemblance": 0.6, "resemblance_least": 0.25, "resemblance_oracle": 0.8, "resemblance_fraction": 0.75,
        "resemblance_joint": 0.25, "resemblance_mean": 0.5, "deviation_ratio": 0.8, "mean_correlation": 0.7,
        "power_least": 0.4, "power_greatest": 1.3, "amount_correlation": 0.95, "amount_error": 0.05,
    }  # fmt: skip
    assert {key: numbers.get(key) for key in wanted} == pytest.approx(wanted)
