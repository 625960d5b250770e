"""Where a vehicle's nose is: numbers that are positive if it is at +Z, and change sign if it is turned about Y."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.ndimage import median_filter

from svbrdfgan.asset.evidence import Evidence
from svbrdfgan.asset.stance import standing

NOSE = MappingProxyType(
    {
        "names": 6.0,
        "lower_half": 14.0,
        "bonnet": 2.9,
        "bed": 0.6,
        "sunk": 49.0,
        "leaning": 43.0,
        "overhang": 27.0,
        "rear_axles": 10.0,
        "rear_wheels": 15.0,
        "mirrors": 5.5,
        "glass_place": 0.3,
        "glass_leaning": 2.4,
        "narrower": 33.0,
    }
)
"""The numbers' names, in order, and weights, with which they add up to the logarithm of the odds for +Z.

The weights are those of a logistic regression on 39 real and 40 procedural vehicles, with and without names. Those of
`names`, `rear_axles` and `rear_wheels` were set by hand: these differ too little among those vehicles.
"""

_BINS = 40
_CABIN = 0.8  # of the height: what is higher is the cabin
_LONG_BONNET = 0.45  # of the length: what is longer is a load bed


def nose(evidence: Evidence) -> Float[ndarray, " numbers"]:
    """The numbers that `NOSE` names, for a vehicle that stands with +Y up."""
    y, z = evidence.relative[:, 1], evidence.relative[:, 2]
    x = np.abs(evidence.relative[:, 0])
    heights, edges = _profile(evidence, x < 0.25), _profile(evidence, (x > 0.25) & (x < 0.47))
    sunk = np.maximum(edges - heights - 0.02, 0.0)
    leaning = _leaning(evidence)
    glass = evidence.said["glass"]
    across = np.abs(evidence.normals[:, 0]) < 0.6
    return np.array(
        [
            _names(evidence, z),
            heights[: _BINS // 2].mean() - heights[_BINS // 2 :].mean(),
            *_cabin(heights / max(float(heights.max()), 1e-9)),
            sunk[: _BINS // 2].mean() - sunk[_BINS // 2 :].mean(),
            float(leaning[y > 0.0].mean()) if (y > 0.0).any() else 0.0,
            *_axles(evidence),
            _mirrors(evidence, z),
            float(z[glass & across].mean()) if (glass & across).sum() > 20 else 0.0,
            float(leaning[glass].mean()) if glass.sum() > 20 else 0.0,
            _width(evidence, z < -0.42) - _width(evidence, z > 0.42),
        ]
    )


def _names(evidence: Evidence, z: Float[ndarray, " points"]) -> float:
    score = 0.0
    for what, sign in (("front", 1.0), ("rear", -1.0)):
        if evidence.said[what].any():
            score += sign * float(np.clip(4.0 * z[evidence.said[what]].mean(), -1.0, 1.0))
    return float(np.clip(score, -1.0, 1.0))


def _profile(evidence: Evidence, chosen: Bool[ndarray, " points"]) -> Float[ndarray, " bins"]:
    """Height of the chosen points from tail to nose, in [0, 1], without aerials and lights on the roof."""
    _, y, z = evidence.relative[chosen].T
    heights = np.zeros(_BINS)
    np.maximum.at(heights, np.clip(((z + 0.5) * _BINS).astype(int), 0, _BINS - 1), y + 0.5)
    return np.asarray(median_filter(heights, 5, mode="nearest"))


def _cabin(heights: Float[ndarray, " bins"]) -> tuple[float, float]:
    """How much longer the bonnet is than the boot, or else the load bed than what is before the cabin."""
    high = np.flatnonzero(heights > _CABIN)
    if not len(high):  # nothing lies in the middle
        return 0.0, 0.0
    behind, before = high[0] / _BINS, (_BINS - 1 - high[-1]) / _BINS
    longer = float(before - behind)
    return (longer, 0.0) if max(behind, before) < _LONG_BONNET else (0.0, -longer)


def _leaning(evidence: Evidence) -> Float[ndarray, " points"]:
    """How far a slope faces +Z: the normal's z if the surface is seen from above, and 0 for walls and roofs."""
    upward = evidence.normals * np.where(evidence.normals[:, 1:2] < 0.0, -1.0, 1.0)
    slope = (upward[:, 1] > 0.15) & (np.abs(upward[:, 0]) < 0.7)
    return np.where(slope, upward[:, 2], 0.0)


def _axles(evidence: Evidence) -> tuple[float, float, float]:
    """How much longer the rear overhang is, how far axles gather at the rear, and how much larger rear wheels are."""
    sure, wheels = standing(evidence)
    if sure == 0.0:
        return 0.0, 0.0, 0.0
    z = wheels.centers[:, 2]
    middle = 0.5 * (z.min() + z.max())
    rear, front = wheels.radii[z < middle].mean(), wheels.radii[z > middle].mean()
    return 2.0 * float(middle), float(middle - z.mean()), float(np.clip((rear - front) / (rear + front), -0.2, 0.2))


def _mirrors(evidence: Evidence, z: Float[ndarray, " points"]) -> float:
    """Where the widest points above the wheels are, if they are few."""
    x, y = np.abs(evidence.relative[:, 0]), evidence.relative[:, 1]
    upper = y > -0.1
    if not upper.any():
        return 0.0
    wide = upper & (x > np.quantile(x[upper], 0.9) + 0.02)
    return float(z[wide].mean()) if wide.any() else 0.0


def _width(evidence: Evidence, chosen: Bool[ndarray, " points"]) -> float:
    return float(np.abs(evidence.relative[chosen, 0]).mean()) if chosen.any() else 0.0
