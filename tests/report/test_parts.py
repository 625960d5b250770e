"""The views that are shown, the discriminator's colours, the curves and the numbers in words."""

import warnings
from dataclasses import replace

import matplotlib
import pytest
import torch

from svbrdfgan.data.config import CameraDistribution, CloseUps
from svbrdfgan.evaluation.evaluated import by_subject
from svbrdfgan.metrics.draw_statistics import PARTS
from svbrdfgan.metrics.resemblance import Resemblance
from svbrdfgan.report.curves import Curve, Level, LineChart, charts, draw
from svbrdfgan.report.draw_facts import draw_verdict
from svbrdfgan.report.facts import duration, flip_bars, half_way, relit_bars, summary
from svbrdfgan.report.patches import CYAN, YELLOW, PatchLogits, Scale, overlay
from svbrdfgan.report.vehicles import choose_views, error_scale, rendered, textured
from svbrdfgan.training.config import LossConfig


def test_one_view_of_each_vehicle_spread_over_all(makers) -> None:
    exemplars = makers.make_evaluated(tuple("abcdefgh"), views=3).source.exemplars
    assert choose_views(exemplars, 20) == list(range(0, 24, 3))
    assert choose_views(exemplars, 2) == [0, 21]
    assert choose_views(exemplars, 1) == [0]


def test_views_without_weathering_are_passed_over(evaluated) -> None:
    exemplars = evaluated.source.exemplars
    clean = exemplars.scenes[0].model_copy(update={"weathering": None})
    assert choose_views(replace(exemplars, scenes=(clean, *exemplars.scenes[1:])), 4) == [1, 2]


def test_of_a_vehicle_s_views_the_best_exposed_is_shown(makers) -> None:
    exemplars = makers.make_evaluated(("a", "b"), views=3).source.exemplars
    scale = torch.tensor([0.01, 100.0, 1.0, 1.0, 0.01, 100.0]).reshape(6, 1, 1, 1)
    middle = exemplars.coverage.unsqueeze(-1) * 0.2 * torch.ones(3)
    assert choose_views(replace(exemplars, images=middle * scale), 2) == [2, 3]


def test_the_true_layer_differs_by_nothing_but_half_precision(evaluated) -> None:
    notes = {shown.title: shown.note for shown in rendered(evaluated, 0).pictures}
    assert notes["Truth"] == "noise alone 0.000"
    assert notes["Oracle"] == "FLIP 0.000"
    assert notes["Learned"] != "FLIP 0.000"


def test_the_error_map_covers_seen_learnable_texels_alone(evaluated) -> None:
    error = next(shown for shown in textured(evaluated, 0, 1.0).pictures if shown.title == "Error of albedo")
    scored = error.picture[..., 3]
    assert scored[16:, :16].all()  # the lower half is paint, the left half is seen
    assert scored.sum() == 16 * 16


def test_a_perfect_layer_has_no_error(evaluated) -> None:
    layers = {**evaluated.layers, "generated": evaluated.layers["oracle"]}
    perfect = replace(evaluated, layers=layers, layers_of=by_subject(evaluated.source.exemplars, layers))
    notes = [shown.note for shown in textured(perfect, 0, 1.0).pictures]
    assert "mean 0.000" in notes
    assert error_scale(perfect, [0, 2]) == 0.05
    assert error_scale(evaluated, [0, 2]) > 0.05


def test_real_is_yellow_fake_is_cyan_and_doubt_keeps_the_grey() -> None:
    white = torch.ones(4, 6, 3)
    picture = overlay(white, torch.tensor([[1.0, 0.0, -1.0]]))
    red, green, blue = picture[0, 0].tolist()
    assert red > blue
    assert green > blue
    assert picture[0, 2].tolist() == pytest.approx([1, 1, 1])
    red, green, blue = picture[0, 5].tolist()
    assert red < green
    assert red < blue
    assert YELLOW[0] > CYAN[0]


@pytest.mark.parametrize("loss", ["vanilla", "lsgan", "wgan", "relativistic"])
def test_leaning_grows_with_the_logit(loss: str) -> None:
    pair = PatchLogits(torch.zeros(2, 2, 3), torch.zeros(2, 2, 3), torch.rand(3, 3) + 3, torch.rand(3, 3) - 3)
    scale = Scale.make(loss, [pair])
    assert (scale.leaning(pair.real_logits) > 0.5).all()
    assert (scale.leaning(pair.fake_logits) < -0.5).all()
    assert scale.legend


def test_an_undecided_logit_is_grey_under_the_losses_that_have_one() -> None:
    pair = PatchLogits(torch.zeros(2, 2, 3), torch.zeros(2, 2, 3), torch.ones(2, 2), torch.ones(2, 2) * 4)
    assert Scale.make("vanilla", [pair]).leaning(torch.zeros(1)) == 0
    assert Scale.make("lsgan", [pair]).leaning(torch.full((1,), 0.5)) == 0


def test_a_chart_has_the_colours_of_the_page_and_leaves_matplotlib_alone() -> None:
    before = dict(matplotlib.rcParams)
    chart = LineChart('A "<b>"', "x", (Curve("a", [0, 1, 2], [0, 1, 4]),), (Level("l", 3, "#010203"),), steps_per_x=0.5)
    svg = draw(chart)
    assert svg.startswith("<svg ")
    assert {"var(--series-1)", "var(--ink-soft)", "var(--line)"} <= set(svg.replace(";", " ").replace('"', " ").split())
    assert "#01020" not in svg
    assert "<metadata>" not in svg
    assert "<b>" not in svg
    assert dict(matplotlib.rcParams) == before


def test_a_value_far_below_a_chart_leaves_it_its_size() -> None:
    low = LineChart("low", "x", (Curve("a", [4], [-9]),), (Level("l", -9, "#010203", x=4),), limits=(-0.25, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert draw(low).startswith("<svg ")


def test_a_bad_run_is_shown_and_a_bad_beginning_is_cut_off(evaluated) -> None:
    verdict, train = evaluated.evaluation, evaluated.config.train

    def low(scores: list[float], recovered: float) -> float | None:
        journal = [{"step": float(n), "recovered": score} for n, score in enumerate(scores)]
        mine = verdict.generated.model_copy(update={"recovered": recovered})
        found = charts(journal, verdict.model_copy(update={"generated": mine}), train)
        return found[0].limits[0]

    assert low([-5.0, 0.2, 0.6], 0.6) == pytest.approx(-0.28)
    assert low([-1.1, -0.7], -0.6) == pytest.approx(-1.13)
    assert low([-5.0, 0.1], -0.6) == pytest.approx(-0.63)


def test_charts_count_images_and_the_oracle_is_a_level(evaluated) -> None:
    journal = [{"step": 10, "g_loss": 1.0}, {"step": 20, "recovered": 0.5, "seconds": 3.0}]
    recovered, losses = charts(journal, evaluated.evaluation, evaluated.config.train)
    assert list(recovered.curves[0].x) == [80]
    assert [level.y for level in recovered.levels] == [0.6123, 0.8741]
    assert list(losses.curves[0].x) == [40]
    assert charts([], evaluated.evaluation, evaluated.config.train) == []


def test_images_of_all_critic_steps_are_counted(evaluated) -> None:
    train = evaluated.config.train.model_copy(update={"loss": LossConfig(critic_steps=5)})
    judged = replace(evaluated, config=evaluated.config.model_copy(update={"train": train}))
    journal = [{"step": 20, "recovered": 0.5, "seconds": 3.0}]
    (recovered,) = charts(journal, evaluated.evaluation, train)
    assert list(recovered.curves[0].x) == [400]
    assert recovered.steps_per_x == 1 / 20
    found = half_way(evaluated.evaluation, train, journal)
    assert found is not None
    assert found.value == "400"
    assert dict(summary(judged, None, journal))["trained"] == "20 steps, 400 images in 3 s"


def test_the_texture_of_windows_names_both_sizes(evaluated) -> None:
    near = CameraDistribution(close_ups=CloseUps(share=1.0, window=16))
    dataset = evaluated.config.dataset.model_copy(update={"camera": near})
    windowed = replace(evaluated, config=evaluated.config.model_copy(update={"dataset": dataset}))
    size = f"{dataset.texture} x {dataset.texture}"
    assert dict(summary(evaluated, None, []))["texture"] == size
    assert dict(summary(windowed, None, []))["texture"] == f"16 x 16 of {size}"


def test_half_the_oracle_is_where_validation_first_passes_it(evaluated) -> None:
    """That of validation, too: the oracle is better on the scored split."""
    journal = [{"step": s, "recovered": r, "seconds": float(s)} for s, r in ((10, 0.2), (20, 0.41), (30, 0.6))]
    found = half_way(evaluated.evaluation, evaluated.config.train, journal)
    assert found is not None
    assert found.value == "80"
    assert "in 20 s" in found.meaning
    assert half_way(evaluated.evaluation, evaluated.config.train, journal[:1]) is None


def test_the_oracle_of_a_distribution_is_beside_resemblance(evaluated) -> None:
    draws = Resemblance(**dict.fromkeys(PARTS, 0.5) | {"joint": 0.2}, subjects=1, draws=2)
    learned = Resemblance(**dict.fromkeys(PARTS, 0.2), subjects=1, draws=2)
    before = evaluated.evaluation
    update = {
        "generated": before.generated.model_copy(update={"draws": learned}),
        "oracle": before.oracle.model_copy(update={"recovered": -0.1, "plateau": None, "draws": draws}),
    }
    found = draw_verdict(before.model_copy(update=update))
    assert [(figure.label, figure.value) for figure in found] == [
        ("resemblance", "0.200"),
        ("least part: patches", "0.20"),
        ("resemblance of the oracle", f"{draws.resemblance:.3f}"),
        ("area seen", "83%"),
    ]
    assert f"this run reaches {0.2 / draws.resemblance:.0%} of it" in found[2].meaning


def test_the_longest_bar_is_full(evaluated) -> None:
    bars = {bar.label: bar.percent for bar in flip_bars(evaluated.evaluation)}
    assert bars["best constant layer"] == 100
    assert bars["learned"] == pytest.approx(100 * 0.0432 / 0.0811)


def test_relit_bars_are_those_of_relit_pictures(evaluated) -> None:
    assert relit_bars(evaluated.evaluation) == []
    before = evaluated.evaluation
    relit = {"constant": 0.2, "generated": 0.1, "truth": 0.02}
    update = {name: before.painters[name].model_copy(update={"relit_flip": flip}) for name, flip in relit.items()}
    bars = relit_bars(before.model_copy(update=update))
    wanted = [("best constant layer", "0.200"), ("learned", "0.100"), ("truth itself (noise alone)", "0.020")]
    assert [(bar.label, bar.value) for bar in bars] == wanted
    assert [bar.percent for bar in bars] == pytest.approx([100, 50, 10])


@pytest.mark.parametrize(("seconds", "told"), [(59.6, "60 s"), (600, "10 min"), (9000, "2.5 h")])
def test_durations_are_told_as_people_do(seconds: float, told: str) -> None:
    assert duration(seconds) == told
