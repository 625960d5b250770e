"""Means, errors and thresholds against the textbook, and against chance itself."""

import numpy as np
import pytest
import torch
from scipy import stats

from svbrdfgan.testing.statistics import (
    CONFIDENCE,
    LEAST_RUNS,
    POWER,
    Estimate,
    block_sums,
    difference,
    estimate,
    fewer,
    least_bias,
    margin,
)


def test_mean_and_standard_error() -> None:
    found = estimate([np.array([1.0, 5.0]), np.array([2.0, 5.0]), np.array([6.0, 5.0])])
    assert found.mean == pytest.approx([3.0, 5.0])
    assert found.error == pytest.approx([np.sqrt(7.0 / 3.0), 0.0])
    assert (found.freedom == 2.0).all()


def test_tensors_are_taken_as_arrays() -> None:
    found = estimate([torch.tensor([1.0], requires_grad=True), torch.tensor([3.0])])
    assert found.mean.dtype == np.float64
    assert found.mean == pytest.approx([2.0])


def test_margin_is_students_corrected_for_all_comparisons() -> None:
    one = Estimate(np.zeros(1), np.ones(1), np.full(1, 9.0))
    four = Estimate(np.zeros((2, 2)), np.full((2, 2), 3.0), np.full((2, 2), 9.0))
    assert margin(one, 0.95) == pytest.approx(stats.t.ppf(0.975, 9))
    assert margin(four, 0.95) == pytest.approx(3.0 * stats.t.ppf(1.0 - 0.05 / 8.0, 9))


def test_margin_holds_with_its_confidence_over_all_comparisons() -> None:
    """Of 4000 families of 8 means, 5 % should go astray somewhere; Bonferroni gives a little less."""
    runs = np.random.default_rng(1).normal(size=(6, 4000, 8))
    found = estimate(list(runs))
    family = Estimate(found.mean[0], found.error[0], found.freedom[0])
    threshold = margin(Estimate(family.mean, np.ones(8), family.freedom), 0.95)
    astray = (abs(found.mean) > threshold * found.error).any(axis=1).mean()
    assert astray == pytest.approx(1.0 - (1.0 - 0.05 / 8.0) ** 8, abs=4.0 * np.sqrt(0.05 * 0.95 / 4000))


def test_least_bias_is_found_with_the_power_it_states() -> None:
    known = Estimate(np.zeros(1), np.full(1, 1.0 / np.sqrt(1000)), np.full(1, 999.0))
    bias = least_bias(known).item()
    means = bias + np.random.default_rng(2).normal(size=20000) / np.sqrt(1000)
    found = (abs(means) > margin(known)).mean()
    assert found == pytest.approx(POWER, abs=0.01)
    assert bias > margin(known, CONFIDENCE).item()


@pytest.mark.parametrize("power", [1.0, 0.25, 0.125])
@pytest.mark.parametrize(("runs", "spp"), [(16, 16), (24, 64), (16, 128)])
def test_fewer_samples_are_the_share_that_is_asked_for(runs: int, spp: int, power: float) -> None:
    few, each = fewer(runs, spp, power)
    assert LEAST_RUNS <= few <= runs
    assert few * each == pytest.approx(power * runs * spp, rel=0.25)
    assert fewer(runs, spp, 1.0) == (runs, spp)


def test_few_runs_stay_as_they_are() -> None:
    assert fewer(2, 16, 0.125) == (2, 2)


def test_difference_is_welchs() -> None:
    a, b = np.random.default_rng(3).normal(size=(5, 1)), 3.0 * np.random.default_rng(4).normal(size=(9, 1))
    found, textbook = difference(estimate(list(a)), estimate(list(b))), stats.ttest_ind(a, b, equal_var=False)
    assert found.mean / found.error == pytest.approx(textbook.statistic)
    assert found.freedom == pytest.approx(textbook.df)


def test_difference_of_what_does_not_vary_has_no_error() -> None:
    still = estimate([np.array(2.0), np.array(2.0)])
    found = difference(still, still)
    assert (found.mean, found.error) == (0.0, 0.0)
    assert margin(found) == 0.0


def test_block_sums() -> None:
    image = torch.arange(16.0).reshape(4, 4, 1).expand(4, 4, 2)
    assert block_sums(image, 2)[..., 1].tolist() == [[10.0, 18.0], [42.0, 50.0]]
