"""Assertions on results: equal up to rounding, or unbiased over seeds with a stated detectable error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.testing.kit import check
from svbrdfgan.testing.quadrature import Quadrature
from svbrdfgan.testing.renderer.base import RendererKit
from svbrdfgan.testing.renderer.cases import Case, RenderedCase
from svbrdfgan.testing.statistics import LEAST_RUNS, Estimate, estimate, fewer, least_bias, margin

RUNS = 24
EXACT = 5e-4
"""What single precision may lose in a sum over a small picture, of its largest term."""

SAMPLES = 1_000_000
"""Camera samples that a test takes in one round, at most, unless it says otherwise."""

_COARSE = 0.25  # power at which half as fine a quadrature is as good, beside the claim
_FIRST_SEED = 1000
_ROUNDS = 4  # of samples, until a bias is found or excluded
_SHARE = 0.02  # of the total: smaller blocks are held to the same absolute error
_ROUNDING = 2e-5  # of the largest value: what single precision may lose

Measure = Callable[[int, int], Float[ndarray, "*shape"]]
"""A measurement with a number of samples per pixel and a seed."""


class StatisticalKit(RendererKit):
    """Tests of means over seeds, at the kit's power."""

    def known(
        self, case: Case, measure: Callable[[Quadrature], Float[ndarray, "*shape"]], grid: int = 4, split: int = 4
    ) -> Known:
        """`Known.by_quadrature`; with little power half as fine, as the errors to be found are larger."""
        if self.power <= _COARSE:
            grid, split = max(2, grid // 2), max(4, split // 2)  # both stay even, so that they can be halved again
        return Known.by_quadrature(case, measure, grid, split)

    def unbiased(
        self,
        what: str,
        rendered: RenderedCase,
        measure: Measure,
        known: Known,
        *,
        claim: float,
        spp: int,
        fixed: bool = False,
        most: int = SAMPLES,
    ) -> None:
        """`unbiased` with the kit's share of the samples, of which a larger error can be claimed to be found."""
        runs, few = (self.count(RUNS), spp) if fixed else fewer(RUNS, spp, self.power)
        claim, most = claim / math.sqrt(self.power), max(SAMPLES, round(self.power * most))
        unbiased(what, rendered, measure, known, claim=claim, spp=few, runs=runs, fixed=fixed, most=most)

    def count(self, runs: int) -> int:
        """The kit's share of the runs, where their samples are fixed."""
        return max(LEAST_RUNS, round(self.power * runs))


@dataclass(frozen=True, eq=False)
class Known:
    """True values.

    Attributes:
        doubt: the error bound of the truth itself.
        size: the values that relative errors refer to.
    """

    truth: Float[ndarray, "*shape"]
    doubt: Float[ndarray, "*shape"]
    size: Float[ndarray, "*shape"]

    @classmethod
    def by_quadrature(
        cls,
        case: Case,
        measure: Callable[[Quadrature], Float[ndarray, "*shape"]],
        grid: int = 4,
        split: int = 4,
    ) -> Known:
        """Values by quadrature of direct light. Their doubt is the difference from a quadrature half as fine."""
        scene = case.surface, case.materials, case.view
        fine, coarse = (measure(Quadrature(*scene, grid // n, split // n)) for n in (1, 2))
        return cls(fine, abs(fine - coarse) + _ROUNDING * abs(fine).max(), abs(fine))

    @classmethod
    def zero(cls, size: Float[ndarray, "*shape"]) -> Known:
        """The known value of differences that should vanish."""
        return cls(np.zeros_like(size), np.full_like(size, _ROUNDING * size.max()), size)


def exactly(
    what: str,
    found: Float[ndarray, "*shape"],
    wanted: Float[ndarray, "*shape"],
    *,
    hint: str = "",
    rounding: float = EXACT,
) -> None:
    """Fails unless two arrays agree up to rounding, relative to the largest. The message says how they differ."""
    check(found.shape == wanted.shape, f"{what} has shape {found.shape}; wanted {wanted.shape}.")
    check(bool(np.isfinite(found).all()), f"{what} holds values that are not finite.")
    scale = abs(wanted).max()
    off = abs(found - wanted)
    worst = np.unravel_index(np.argmax(off), off.shape)
    place = tuple(int(i) for i in worst)
    numbers = f"{what} at {place} is {found[worst]:.6g}, and should be {wanted[worst]:.6g}"
    check(bool(off.max() <= rounding * scale), f"{numbers}: {_manner(found, wanted)}. {hint}".rstrip())


def _manner(found: ndarray, wanted: ndarray) -> str:
    factor = (found * wanted).sum() / max((wanted**2).sum(), 1e-300)
    if abs(found - factor * wanted).max() <= EXACT * abs(wanted).max():
        return f"all are {factor:.4f} times what they should be"
    if abs(found.sum() - wanted.sum()) <= EXACT * abs(wanted).sum():
        return "the sum is right, so the shares go to the wrong places"
    return f"the sum is {found.sum():.6g}, and should be {wanted.sum():.6g}"


def unbiased(
    what: str,
    rendered: RenderedCase,
    measure: Measure,
    known: Known,
    *,
    claim: float,
    spp: int,
    runs: int = RUNS,
    fixed: bool = False,
    most: int = SAMPLES,
) -> None:
    """Fails where the mean over seeds is not the truth, or where a relative bias of `claim` might not be detected.

    The claim is for all values that make up a fiftieth of the total or more. Starts with `spp` samples per pixel and
    takes more if these are too few, or more seeds if `fixed`, up to `most` camera samples in each round. A
    deterministic renderer must be right within the claim.
    """
    if not rendered.renderer.capabilities.stochastic:
        none = np.zeros_like(known.truth)
        loose = Known(known.truth, known.doubt + claim * np.maximum(known.size, _SHARE * known.size.sum()), known.size)
        return _judge(what, Estimate(measure(spp, 0), none, none + 1.0), loose, "without chance")
    seed = _FIRST_SEED
    for _ in range(_ROUNDS):
        found = _over_seeds(measure, spp, runs, seed)
        blind = _blindness(found, known, claim)
        more = (
            (spp, _more(rendered, blind, runs, spp, most)) if fixed else (_more(rendered, blind, spp, runs, most), runs)
        )
        if blind <= 1.0 or more == (spp, runs):
            break
        (spp, runs), seed = more, seed + runs
    _judge(what, found, known, f"on average over {runs} seeds of {spp} samples per pixel")
    check(
        blind <= 1.0,
        f"{what}: too noisy to tell. From {runs} seeds of {spp} samples per pixel one would see an error of "
        f"{claim * blind:.1%}, and should see one of {claim:.0%}: draw directions where light is.",
    )


def _over_seeds(measure: Measure, spp: int, runs: int, first: int) -> Estimate:
    return estimate([measure(spp, first + run) for run in range(runs)])


def _more(rendered: RenderedCase, blind: float, have: int, each: int, most: int) -> int:
    """The number needed, with half of it to spare, and at most `most` camera samples in all."""
    limit = most // (each * rendered.case.view.height * rendered.case.view.width)
    return max(have, min(limit, int(1.5 * have * min(blind, 1e3) ** 2)))


def _blindness(found: Estimate, known: Known, claim: float) -> float:
    """The least detectable error divided by the claimed one, for the worst value that counts."""
    large = known.size >= _SHARE * known.size.sum()
    wanted = np.maximum(claim * known.size - known.doubt, 1e-6 * known.size.max())
    return float((least_bias(found) / wanted)[large].max(initial=0.0))


def _judge(what: str, found: Estimate, known: Known, how: str) -> None:
    check(bool(np.isfinite(found.mean).all()), f"{what}: there are values that are not finite.")
    limit = margin(found) + known.doubt
    off = abs(found.mean - known.truth)
    worst = np.unravel_index(np.argmax(off / limit), off.shape)
    place, wrong = tuple(int(i) for i in worst), int((off > limit).sum())
    check(
        wrong == 0,
        f"{what}: value {place} is {found.mean[worst]:.5g} {how}, and should be {known.truth[worst]:.5g} within "
        f"{limit[worst]:.2g}. {wrong} of {off.size} values are off; their sum is {found.mean.sum():.5g}, "
        f"and should be {known.truth.sum():.5g}.",
    )
