"""How well a vehicle stands: numbers that are large if +Y is up and the Z axis runs from tail to nose."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.spatial import cKDTree

from svbrdfgan.asset.evidence import Evidence
from svbrdfgan.asset.round_pieces import Wheels

STANCE = MappingProxyType(
    {
        "wheels": 6.0,
        "mirrored": 2.2,
        "upright": 1.2,
        "longer_than_wide": 1.9,
        "longer_than_tall": 1.8,
        "tapered": 15.0,
        "heavy": 18.0,
        "named": 5.6,
    }
)
"""The numbers' names, in order, and weights, with which they add up to the logarithm of a likelihood.

The weights are those of a conditional logistic regression over the twelve stances of each of the same vehicles as for
`NOSE`. That of `wheels` was set by hand: they tell nearly always, so that a fit cannot say how much they count.
"""

_QUERIES = 2_000
_SPACING = 0.01  # between a point and its nearest neighbour, on most vehicles
_LEVEL = 0.03  # wheels' lowest points on one plane, of the longest side


def asymmetry(evidence: Evidence) -> Float[ndarray, " axes"]:
    """For each axis, the mean distance from a point's mirror image to the surface, in longest sides."""
    tree = cKDTree(evidence.points)
    some = evidence.points[:: len(evidence.points) // _QUERIES]
    mirrored = [some * np.where(np.arange(3) == axis, -1.0, 1.0) for axis in range(3)]
    return np.array([tree.query(points)[0].mean() for points in mirrored])


def stance(evidence: Evidence, asymmetric: Float[ndarray, " axes"]) -> Float[ndarray, " numbers"]:
    """The numbers that `STANCE` names, none of which changes if nose and tail are exchanged."""
    x, y, z = evidence.relative.T
    narrow = np.log(np.maximum(evidence.sides, 0.01))
    doubt = np.log(asymmetric + _SPACING)
    top, bottom = y > 0.3, (y < 0.0) & (y > -0.4)
    taper = [_spread(side[bottom]) - _spread(side[top]) for side in (x, z)]
    return np.array(
        [
            standing(evidence)[0],
            -doubt[0],
            doubt[1],
            narrow[2] - narrow[0],
            narrow[2] - narrow[1],
            float(np.sum(taper)),
            -float(y.mean()),
            _named(evidence, y),
        ]
    )


def standing(evidence: Evidence) -> tuple[float, Wheels]:
    """How surely the vehicle stands on wheels that turn about X, from 0 to 1, and those wheels."""
    wheels = evidence.wheels
    rolling = np.flatnonzero(wheels.axles == 0)
    if not len(rolling):
        return 0.0, wheels.chosen(rolling)
    bottoms = wheels.centers[:, 1] - wheels.radii
    on_ground = rolling[bottoms[rolling] < bottoms[rolling].min() + _LEVEL]
    found = wheels.chosen(on_ground)
    apart = np.ptp(found.centers[:, 2]) > 1.5 * found.radii.max()
    gap = (bottoms[on_ground].min() + 0.5 * evidence.sides[1]) / evidence.sides[1]
    grounded = float(np.clip(1.0 - gap / 0.2, 0.0, 1.0))
    return (min(len(on_ground), 4) / 4.0 * grounded if apart else 0.0), found


def _spread(values: Float[ndarray, " some"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0


def _named(evidence: Evidence, y: Float[ndarray, " points"]) -> float:
    """How much higher glass lies than everything, and that than wheels."""
    score = 0.0
    for what, sign in (("glass", 1.0), ("wheel", -1.0)):
        chosen = evidence.said[what]
        if 0 < chosen.sum() < 0.6 * len(chosen):
            score += sign * float(np.clip(y[chosen].mean() - y.mean(), -0.2, 0.2))
    return score
