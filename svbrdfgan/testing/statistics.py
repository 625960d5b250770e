"""Means of independent runs and confidence intervals: Student's t, corrected for many comparisons (Bonferroni)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.special import stdtrit
from torch import Tensor

CONFIDENCE = 0.9999
"""A right plugin passes a test, with all comparisons in it, with at least this probability."""

POWER = 0.95
"""A bias of the size that a test claims to find is found with at least this probability."""


LEAST_RUNS = 8
"""Independent runs from which a standard error is taken, at least: with fewer, Student's t would hide most errors."""


def fewer(runs: int, spp: int, power: float) -> tuple[int, int]:
    """Runs and samples per pixel, which together are this share of those given; never more runs."""
    few = max(min(runs, LEAST_RUNS), round(runs * math.sqrt(power)))
    return few, max(1, round(power * runs * spp / few))


@dataclass(frozen=True, eq=False)
class Estimate:
    """The means of independent runs.

    Attributes:
        mean: over the runs.
        error: the standard error of that mean.
        freedom: degrees of freedom of the error.
    """

    mean: Float[ndarray, "*shape"]
    error: Float[ndarray, "*shape"]
    freedom: Float[ndarray, "*shape"]


def estimate(runs: Sequence[Float[ndarray, "*shape"] | Float[Tensor, "*shape"]]) -> Estimate:
    """The mean of two or more independent runs of one shape."""
    values = np.stack([numbers(run) for run in runs])
    error = np.asarray(values.std(axis=0, ddof=1) / np.sqrt(len(values)))
    return Estimate(np.asarray(values.mean(axis=0)), error, np.full(error.shape, len(values) - 1.0))


def difference(a: Estimate, b: Estimate) -> Estimate:
    """The mean of `a` minus that of `b`, independent of `a`; degrees of freedom by Welch (1947)."""
    variance_a, variance_b = a.error**2, b.error**2
    variance = variance_a + variance_b
    spread = variance_a**2 / a.freedom + variance_b**2 / b.freedom
    freedom = np.divide(variance**2, spread, out=np.array(np.minimum(a.freedom, b.freedom)), where=spread > 0.0)
    return Estimate(a.mean - b.mean, np.sqrt(variance), freedom)


def margin(found: Estimate, confidence: float = CONFIDENCE) -> Float[ndarray, "*shape"]:
    """Half the width of the confidence interval: with this probability no mean of all lies further from the truth.

    Zero where all runs are equal, so callers add an allowance for rounding.
    """
    tail = (1.0 - confidence) / (2.0 * max(found.mean.size, 1))
    return np.asarray(-stdtrit(found.freedom, tail) * found.error)


def least_bias(found: Estimate, confidence: float = CONFIDENCE, power: float = POWER) -> Float[ndarray, "*shape"]:
    """The least bias that moves a mean beyond `margin` with probability `power`: the least error detected."""
    return margin(found, confidence) + stdtrit(found.freedom, power) * found.error


def block_sums(image: Float[Tensor, "height width channels"] | ndarray, size: int) -> Float[ndarray, "rows cols c"]:
    """The sum over every block of size x size pixels, which must divide the image."""
    values = numbers(image)
    height, width, channels = values.shape
    return values.reshape(height // size, size, width // size, size, channels).sum(axis=(1, 3))


def numbers(values: Float[ndarray, "*shape"] | Float[Tensor, "*shape"]) -> Float[ndarray, "*shape"]:
    """The values as a NumPy array of float64."""
    array = values.detach().cpu().numpy() if isinstance(values, torch.Tensor) else values
    return np.asarray(array, dtype=np.float64)
