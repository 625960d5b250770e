"""Brightness, measured over independent seeds and compared with known values."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.testing.kit import check
from svbrdfgan.testing.quadrature import Quadrature
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.testing.statistics import Estimate, estimate, fewer, margin
from svbrdfgan.types import Materials, Rendering, Surface, View

Inputs = tuple[Surface, Materials, View]
Radiances = Float[ndarray, "runs cases 3"]
Brightnesses = Float[ndarray, "runs cases"]

RUNS = 16
ROUNDING = 2e-3
"""The relative error allowed beside noise: single precision, and rays that start off the surface."""
GRAIN = 2e-2
"""The same for deterministic renderers, whose samples lie on a grid."""


class MeasuredKit(RendererKit):
    """Tests that compare means over seeds with known answers."""

    @cached_property
    def seeds(self) -> Iterator[int]:
        """A new seed for each picture, so that all are independent."""
        return itertools.count(1)

    @property
    def slack(self) -> float:
        return ROUNDING if self.capabilities.stochastic else GRAIN

    def pictures(self, *cases: Inputs, spp: int = 16, runs: int = RUNS) -> list[list[Rendering]]:
        """A picture of each case for each run, each with its own seed."""
        runs, spp = fewer(runs, spp, self.power) if self.capabilities.stochastic else (2, spp)
        ready = [(self.renderer.prepare(surface), materials, view) for surface, materials, view in cases]
        return [[self.renderer.render(*case, spp=spp, seed=next(self.seeds)) for case in ready] for _ in range(runs)]

    def radiances(self, *cases: Inputs, spp: int = 16, runs: int = RUNS) -> Radiances:
        """The mean over the film of each picture. The surface must fill the views."""
        pictures = self.pictures(*cases, spp=spp, runs=runs)
        return np.array([[p.image.double().mean(dim=(0, 1)).cpu().numpy() for p in run] for run in pictures])

    def brightnesses(self, *cases: Inputs, spp: int = 16, runs: int = RUNS) -> Brightnesses:
        """The mean of the channels of `radiances`."""
        return self.radiances(*cases, spp=spp, runs=runs).mean(axis=-1)

    def check_values(
        self, runs: ndarray, truth: Sequence[float] | ndarray, message: str, slack: float | None = None
    ) -> None:
        """Fails unless the mean over the runs is the truth, within noise and rounding: `slack`, or the kit's."""
        wanted = np.asarray(truth, dtype=np.float64)
        _compare(estimate(list(runs)), wanted, (slack or self.slack) * np.abs(wanted).max(), message)

    def check_ratios(self, runs: Brightnesses, truth: Sequence[float] | ndarray, message: str) -> None:
        """Fails unless the ratios between the cases are those of the truth; a common factor does not matter."""
        wanted = np.asarray(truth, dtype=np.float64)
        total = runs.mean(axis=0).sum()
        check(bool(np.isfinite(total) and total > 0.0), f"All is black or not finite (sum of means {total:.4g}).")
        share = wanted / wanted.sum()
        excess = estimate(list(runs - share * runs.sum(axis=1, keepdims=True)))
        found = Estimate(excess.mean / total + share, excess.error / total, excess.freedom)
        _compare(found, share, self.slack * share.max(), message)


def expected(*cases: Inputs, split: int = 16) -> Float[ndarray, "cases 3"]:
    """The true values of `radiances`, by quadrature of direct light."""
    pictures = [Quadrature(*case, grid=1, split=split).image() for case in cases]
    return np.array([picture.mean(axis=(0, 1)) for picture in pictures])


def check_zero(values: ndarray, message: str) -> None:
    """Fails unless every value is exactly zero."""
    check(not np.any(values), f"{message} Found up to {np.abs(values).max():.4g}; wanted exactly 0.")


def _compare(found: Estimate, wanted: ndarray, slack: float, message: str) -> None:
    allowed = margin(found) + slack
    off = ~(np.abs(found.mean - wanted) <= allowed)  # what is not a number is off as well
    worst = zip(*_worst(found.mean, wanted, allowed), strict=True)
    values = ", ".join(f"{mean:.4g} (wanted {truth:.4g} +- {room:.2g})" for mean, truth, room in worst)
    check(not off.any(), f"{message} Found {values}.")


def _worst(found: ndarray, wanted: ndarray, allowed: ndarray, count: int = 3) -> tuple[ndarray, ndarray, ndarray]:
    """The entries with the largest errors, as flat arrays."""
    found, wanted, allowed = (values.ravel() for values in np.broadcast_arrays(found, wanted, allowed))
    excess = np.nan_to_num(np.abs(found - wanted) / np.maximum(allowed, 1e-12), nan=np.inf)
    order = np.argsort(-excess)[:count]
    return found[order], wanted[order], allowed[order]
