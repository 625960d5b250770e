"""Figures of draws: 1 for other draws of the same, and each sees its own fault."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from svbrdfgan.metrics.draw_figures import DrawFigures, amount_figures, draw_figures
from svbrdfgan.metrics.draw_statistics import ScoredSurface
from svbrdfgan.types import Layer

SIZE = 32
DRAWS = 16


def surface() -> ScoredSurface:
    """The lower half is scored, the left of it with twice the area."""
    weight = torch.zeros(SIZE, SIZE)
    weight[: SIZE // 2] = 1.0
    weight[: SIZE // 2, : SIZE // 2] = 2.0
    return ScoredSurface(weight, torch.zeros(SIZE, SIZE, dtype=torch.long))


def draws(seed: int, spread: float = 0.2, slope: float = 0.1) -> Tensor:
    """Alpha rises along the rows by `slope` times the deviation of a ramp; each texel is drawn on its own."""
    rng = torch.Generator().manual_seed(seed)
    layers = torch.rand(DRAWS, SIZE, SIZE, 4, generator=rng)
    ramp = torch.linspace(-1.7, 1.7, SIZE // 2).repeat(2)[:, None]
    layers[..., 3] = 0.5 + slope * ramp + spread * torch.randn(DRAWS, SIZE, SIZE, generator=rng)
    return layers


def figures(made: Tensor, truth: Tensor | None = None) -> DrawFigures:
    return draw_figures([surface()], [Layer(draws(0) if truth is None else truth)], [Layer(made)])


def test_other_draws_of_the_same_have_ratios_of_one() -> None:
    found = figures(draws(1))
    assert found.deviation == pytest.approx(1.0, abs=0.03)
    assert found.mean_correlation == pytest.approx(1.0, abs=0.05)
    assert found.power == pytest.approx([1.0] * 3, abs=0.1)
    assert found.amount is None


def test_the_number_of_draws_takes_nothing_from_the_correlation() -> None:
    """By themselves, means of 16 draws correlate by 0.5 where their error is as large as the deviation of the map."""
    wide = [draws(seed, spread=0.4) for seed in (0, 1)]
    plain = torch.corrcoef(torch.stack([w[:, : SIZE // 2, :, 3].mean(dim=0).flatten() for w in wide]))[0, 1]
    assert plain < 0.6
    assert figures(wide[1], wide[0]).mean_correlation == pytest.approx(1.0, abs=0.15)


def test_wrong_places_do_not_correlate() -> None:
    moved = draws(1).flip(1).roll(SIZE // 2, dims=1)  # the ramp falls where it should rise
    assert figures(moved).mean_correlation == pytest.approx(-1.0, abs=0.05)
    even = draws(1)
    even[..., 3] = 0.5
    assert figures(even).mean_correlation == 0.0


def test_draws_that_agree_have_no_deviation() -> None:
    frozen = draws(1)[:1].expand(DRAWS, -1, -1, -1)
    assert figures(frozen).deviation == 0.0
    assert figures(draws(1, spread=0.1)).deviation == pytest.approx(0.5, abs=0.03)


def test_blur_takes_the_power_of_the_finest_octave() -> None:
    blurred = draws(1)
    blurred[..., 3] = torch.nn.functional.avg_pool2d(blurred[..., 3], 3, 1, 1)
    finest, *_, coarsest = figures(blurred).power
    assert finest < 0.2
    assert coarsest > 0.6


def relieved(seed: int, steep: float = 0.2) -> Layer:
    """Draws with normals whose x and y are noise of this deviation."""
    tilted = steep * torch.randn(DRAWS, SIZE, SIZE, 2, generator=torch.Generator().manual_seed(seed))
    further = [torch.full((DRAWS, SIZE, SIZE, 1), 0.8), tilted, torch.ones(DRAWS, SIZE, SIZE, 1)]
    return Layer(torch.cat([draws(seed), *further], dim=-1), ("roughness", "normal"))


def test_relief_is_the_power_of_slopes_by_octave() -> None:
    truth = relieved(0)
    other, flatter = (draw_figures([surface()], [truth], [relieved(1, steep)]) for steep in (0.2, 0.1))
    assert other.relief == pytest.approx([1.0] * 3, abs=0.1)
    assert flatter.relief == pytest.approx([0.25] * 3, abs=0.03)
    assert flatter.power == other.power, "that is of alpha"
    assert "; relief 0.2" in flatter.line()
    smooth = relieved(1)
    smooth["normal"][..., :2] = smooth["normal"][:, ::4, ::4, :2].repeat_interleave(4, 1).repeat_interleave(4, 2)
    smooth["alpha"][:] = truth["alpha"][:] = 1.0
    finest, second, third = draw_figures([surface()], [truth], [smooth]).relief
    assert max(finest, second) < 0.001
    assert third == pytest.approx(16.0, rel=0.2)


def test_relief_counts_where_it_covers() -> None:
    hidden, truth = relieved(1), relieved(0)
    hidden["normal"][..., :2] += torch.where(hidden.alpha < 0.5, 9.0, 0.0)[..., None]
    hidden["alpha"][hidden.alpha < 0.5] = 0.0
    truth["alpha"][truth.alpha < 0.5] = 0.0
    assert draw_figures([surface()], [truth], [hidden]).relief == pytest.approx([1.0] * 3, abs=0.15)


def test_octaves_without_relief_that_one_sees_have_one() -> None:
    flat = relieved(0, steep=0.0)
    faint, seen = (draw_figures([surface()], [flat], [relieved(1, steep)]).relief for steep in (0.001, 0.1))
    assert faint == pytest.approx([1.0] * 3, abs=0.2)
    assert min(seen) > 5.0


def test_there_is_no_relief_without_normals() -> None:
    found = figures(draws(1))
    assert found.relief == ()
    assert "relief" not in found.line()


def test_what_is_not_scored_does_not_count() -> None:
    made = draws(1)
    made[:, SIZE // 2 :] = 0.0
    assert figures(made) == figures(draws(1))


def test_amounts_are_ranked_and_compared() -> None:
    truth = torch.tensor([0.0, 0.1, 0.3, 0.8])
    same = amount_figures([truth], [truth])
    assert (same.correlation, same.error) == (pytest.approx(1.0), 0.0)
    assert amount_figures([truth], [truth.square()]).correlation == pytest.approx(1.0)
    assert amount_figures([truth], [-truth]).correlation == pytest.approx(-1.0)
    deaf = amount_figures([truth], [torch.full((4,), 0.3)])
    assert deaf.correlation == 0.0
    assert deaf.error == pytest.approx((0.3 + 0.2 + 0.0 + 0.5) / 4)
    both = amount_figures([truth, truth], [truth, -truth])
    assert both.correlation == pytest.approx(0.0)
    assert "rank 0.00, error 0.300" in figures(draws(1)).model_copy(update={"amount": both}).line()
