"""Statistical comparison of two renderers in one quantity of one scene, with the least detectable difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.testing.pairs.pair_scene import PairScene
from svbrdfgan.testing.pairs.quantity import Quantity
from svbrdfgan.testing.statistics import Estimate, difference, estimate, least_bias, margin

FALSE_ALARMS = 0.01
"""The greatest probability that a table of right renderers shows any disagreement (Bonferroni)."""

LEAST_SIGMA = 4.0
SMALL = 0.01
"""Blocks that hold less than this share of the total are pooled."""

_ROUNDING = 2e-6  # of the total: what single precision may lose in a sum


@dataclass(frozen=True, eq=False)
class Runs:
    """Independent runs of one renderer: what each measured, from how many camera samples together."""

    values: Float[ndarray, "runs blocks"]
    samples: int

    def over(self, cells: Cells) -> Estimate:
        """The mean of each cell and its error."""
        return estimate(list(self.values @ cells.members))

    def joined(self, more: Runs) -> Runs:
        """The runs with others, of as many samples each."""
        return Runs(np.concatenate([self.values, more.values]), self.samples + more.samples)


@dataclass(frozen=True, eq=False)
class Cells:
    """The tested parts of a quantity: its sum, each block that is not small, and the small ones pooled.

    Attributes:
        members: 1 where a block belongs to a cell. The first cell is the sum.
        share: of the total, for each cell.
    """

    labels: tuple[str, ...]
    members: Float[ndarray, "blocks cells"]
    share: Float[ndarray, " cells"]

    def tolerance(self, of_sum: float, of_block: float) -> Float[ndarray, " cells"]:
        """The relative bias that must be found in each cell; infinite where a pool is small still."""
        wanted = np.where(self.share >= SMALL, of_block, np.inf)
        wanted[0] = of_sum
        return wanted


def cells_of(quantity: Quantity, scene: PairScene, mean: Float[ndarray, " blocks"]) -> Cells:
    """The cells for blocks of such a mean: small blocks are pooled along the first axis, small pools all together.

    Where the mean is that of the two sides of a comparison, to choose by it leaves their difference a fair test.
    """
    share = np.clip(mean, 0.0, None)
    share = share / max(share.sum(), np.finfo(float).tiny)
    first = np.arange(len(mean)) // max(1, len(mean) // quantity.shape(scene)[0])
    pool = np.bincount(first, np.where(share < SMALL, share, 0.0))[first]
    singles = [(quantity.label(scene, int(block)), np.array([block])) for block in np.flatnonzero(share >= SMALL)]
    small, lesser = (share < SMALL) & (pool >= SMALL), (share < SMALL) & (pool < SMALL)
    pools = [
        (f"rest of {quantity.place(0, int(at))}", np.flatnonzero(small & (first == at)))
        for at in np.unique(first[small])
    ]
    rest = [("rest", np.flatnonzero(lesser))] if lesser.any() else []
    chosen = [("sum", np.arange(len(mean))), *singles, *pools, *rest]
    members = np.zeros((len(mean), len(chosen)))
    for cell, (_, blocks) in enumerate(chosen):
        members[blocks, cell] = 1.0
    return Cells(tuple(label for label, _ in chosen), members, share @ members)


@dataclass(frozen=True, eq=False)
class Comparison:
    """The test of one quantity, cell by cell; see `Cells`. Differences and biases are relative to the cell's size.

    Attributes:
        difference: of the first from the second, with its standard error.
        limit: the |z| that is a disagreement.
        finds: the least bias found with 95 % power.
        tolerance: the greatest that `finds` may be; infinite where nothing is promised.
    """

    quantity: str
    labels: tuple[str, ...]
    difference: Float[ndarray, " cells"]
    error: Float[ndarray, " cells"]
    limit: Float[ndarray, " cells"]
    finds: Float[ndarray, " cells"]
    tolerance: Float[ndarray, " cells"]

    @property
    def z(self) -> Float[ndarray, " cells"]:
        return self.difference / self.error

    @property
    def worst(self) -> int:
        """The cell that is nearest to, or furthest beyond, its limit."""
        return int(np.argmax(np.abs(self.z) / self.limit))

    @property
    def differs(self) -> Bool[ndarray, " cells"]:
        return np.abs(self.z) > self.limit

    @property
    def underpowered(self) -> Bool[ndarray, " cells"]:
        return self.finds > self.tolerance


def compare(
    a: Runs, b: Runs, quantity: Quantity, scene: PairScene, tolerances: tuple[float, float], family: int
) -> Comparison:
    """Welch's test of every cell, one of `family` comparisons that together raise FALSE_ALARMS at most.

    Args:
        tolerances: the relative bias to be found in the sum, and in blocks that are not small.
    """
    cells = cells_of(quantity, scene, 0.5 * (a.values.mean(axis=0) + b.values.mean(axis=0)))
    found_a, found_b = a.over(cells), b.over(cells)
    size = 0.5 * np.abs(found_a.mean + found_b.mean)
    apart = difference(found_a, found_b)
    error = np.hypot(apart.error, _ROUNDING * size[0])
    # Cells of nothing, in scenes of nothing, have neither size nor error to divide by.
    size, error = np.maximum(size, 1e-12 * size[0] + 1e-300), np.maximum(error, 1e-300)
    relative = Estimate(apart.mean / size, error / size, apart.freedom)
    limit, power = limits(relative, family)
    return Comparison(
        quantity.name,
        cells.labels,
        relative.mean,
        relative.error,
        limit,
        (limit + power) * relative.error,
        cells.tolerance(*tolerances),
    )


def limits(found: Estimate, family: int) -> tuple[Float[ndarray, " cells"], Float[ndarray, " cells"]]:
    """The limit of a difference by chance, and how much further a bias lies to be found; both in standard errors."""
    confidence = 1.0 - FALSE_ALARMS * found.mean.size / family
    unit = Estimate(found.mean, np.ones_like(found.error), found.freedom)
    chance = margin(unit, confidence)
    return np.maximum(chance, LEAST_SIGMA), least_bias(unit, confidence) - chance
