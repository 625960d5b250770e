"""The number of runs of a renderer that a test needs, judged by their standard errors.

The errors decide when to stop, never the differences, so stopping does not bias the test.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from svbrdfgan.testing.pairs.compare import Runs, cells_of, limits
from svbrdfgan.testing.pairs.pair_scene import PairScene
from svbrdfgan.testing.pairs.quantity import Quantity, RenderedScene
from svbrdfgan.testing.statistics import Estimate

_PILOT = 16  # runs, of one sample per pixel
_CAUTION = 0.4  # of what the pilot asks for is taken at first: the worst of many noisy variances is too large
_RUN_SAMPLES = 2**22  # camera samples in one run at most, which bounds its memory
_SPARE = 0.95  # of the variance allowed is used: the comparison takes sizes and degrees of freedom from both renderers
_LEAST_SHARE = 0.1  # of the variance allowed in all: no reference is so coarse that a renderer is held to less


@dataclass(frozen=True)
class Profile:
    """The biases that a comparison must detect.

    Attributes:
        of_sum, of_block: relative bias found with 95 % power in a quantity's sum, and in each block that is not small.
        runs: at the least; more give the errors more degrees of freedom.
        limit: camera samples of one renderer for one quantity, at most; where they are too few, the test has failed.
    """

    name: str
    of_sum: float
    of_block: float
    runs: int
    limit: int

    @property
    def tolerances(self) -> tuple[float, float]:
        return self.of_sum, self.of_block


CI = Profile("ci", of_sum=0.01, of_block=0.05, runs=40, limit=2**26)
SLOW = Profile("slow", of_sum=0.01, of_block=0.01, runs=64, limit=2**32)
PROFILES: Mapping[str, Profile] = MappingProxyType({profile.name: profile for profile in (CI, SLOW)})


@dataclass(frozen=True)
class Aim:
    """The comparison that a renderer's runs of one quantity must allow.

    Attributes:
        family: comparisons in the whole table.
        rivals: whether other renderers are sampled too, so that each may have only half of the variance.
        references: stored runs that these will be compared with.
    """

    profile: Profile
    family: int
    rivals: bool
    references: Sequence[Runs] = ()

    def excess(self, quantity: Quantity, scene: PairScene, runs: Runs) -> float:
        """The factor by which the variance of the worst cell is too large for the profile."""
        cells = cells_of(quantity, scene, runs.values.mean(axis=0))
        found = runs.over(cells)
        freedom = np.maximum(found.freedom, self.profile.runs - 1.0)
        limit, power = limits(Estimate(found.mean, found.error, freedom), self.family)
        tolerance = cells.tolerance(*self.profile.tolerances)
        promised = np.isfinite(tolerance) & (found.error > 0.0)
        wanted = _SPARE * np.square(tolerance[promised] * np.abs(found.mean)[promised] / (limit + power)[promised])
        spend = wanted / 2.0 if self.rivals else wanted
        for reference in self.references:
            left = wanted - reference.over(cells).error[promised] ** 2
            spend = np.minimum(spend, np.maximum(left, _LEAST_SHARE * wanted))
        return float((found.error[promised] ** 2 / spend).max(initial=0.0))


def sample(rendered: RenderedScene, quantity: Quantity, aim: Aim) -> Runs:
    """Enough runs for the aim, or as many as the profile's limit allows."""
    if not rendered.renderer.capabilities.stochastic:
        return _exact(rendered, quantity)
    seed = zlib.crc32(f"{rendered.name}/{quantity.name}/{rendered.scene.name}".encode()) % 2**12 << 16
    pilot = _runs(rendered, quantity, _PILOT, 1, seed)
    need = _CAUTION * _PILOT * aim.excess(quantity, rendered.scene, pilot)
    spp = min(math.ceil(need / aim.profile.runs) or 1, max(1, _RUN_SAMPLES // rendered.scene.pixels))
    room = max(2, aim.profile.limit // (spp * rendered.scene.pixels))
    count = min(room, max(aim.profile.runs, math.ceil(need / spp)))
    runs = _runs(rendered, quantity, count, spp, seed + _PILOT)
    while (excess := aim.excess(quantity, rendered.scene, runs)) > 1.0 and count < room:
        more = min(room, math.ceil(count * min(1.05 * excess, 4.0)) + 1) - count
        runs = runs.joined(_runs(rendered, quantity, more, spp, seed + _PILOT + count))
        count += more
    return runs


def _runs(rendered: RenderedScene, quantity: Quantity, count: int, spp: int, seed: int) -> Runs:
    values = [quantity.measure(rendered, spp, seed + run) for run in range(count)]
    return Runs(np.stack(values), count * spp * rendered.scene.pixels)


def _exact(rendered: RenderedScene, quantity: Quantity) -> Runs:
    """A deterministic renderer's one answer, which has no error."""
    spp = max(1, _RUN_SAMPLES // rendered.scene.pixels)
    return Runs(np.tile(quantity.measure(rendered, spp, 0), (2, 1)), spp * rendered.scene.pixels)
