"""Seeded noise that recipes in torch are built on: waves, spots, streaks of water, and scratches.

All are functions of position alone, in cells: scale positions to choose the size. Warp computes them where installed,
else `noise_reference` does, slower and on the CPU; both agree to float32 rounding. A seed gives the same bytes on the
same machine, on any number of threads. Different seeds are independent, and so are different primitives of one seed.

Far from the origin float32 positions are coarse themselves: steps are 1/1000 of a cell at 10,000 cells. Nothing is lost
beyond that. Coordinates must stay below 2^24.

A share says which part of the shapes is there. At 0 there is none, and only from 1.1 on are all of them whole.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from svbrdfgan.weathering.noise_reference import MOST_WIDTH as MOST_WIDTH

MOST_OCTAVES = 32


@dataclass(frozen=True, eq=False)
class Spots:
    """The spot that each point lies deepest in.

    Attributes:
        inside: 0 at its border and outside of all, 1 at its centre.
        random: numbers in [0, 1) of the spot; 0 outside of all.
    """

    inside: Float[Tensor, " points"]
    random: Float[Tensor, "points 4"]


@dataclass(frozen=True, eq=False)
class Streaks:
    """The streak that is strongest at each point; all are 0 where there is none.

    Attributes:
        strength: in [0, 1], continuous.
        along: from 0 at its head to 1 at its tail.
        head: the head's place minus the point's.
        random: numbers in [0, 1) of the streak.
    """

    strength: Float[Tensor, " points"]
    along: Float[Tensor, " points"]
    head: Float[Tensor, "points 2"]
    random: Float[Tensor, "points 4"]


@dataclass(frozen=True, eq=False)
class Scratches:
    """The scratch with the least `across / weight` at each point.

    A function of `across / weight` that is 0 from `MOST_WIDTH` on, such as a profile, is continuous everywhere: a
    scratch that fades becomes narrow.

    Attributes:
        across: distance to it, in cells; at most `MOST_WIDTH`, which it is where there is none nearer.
        along: from -1 at one end to 1 at the other, which it stays beyond them.
        weight: in [0, 1]: how much of it is there; 0 where there is none.
        random: numbers in [0, 1) of the scratch; 0 where there is none.
    """

    across: Float[Tensor, " points"]
    along: Float[Tensor, " points"]
    weight: Float[Tensor, " points"]
    random: Float[Tensor, "points 4"]


def fbm(
    points: Float[Tensor, "points 3"], seed: int, *, octaves: float = 3, gain: float = 0.5
) -> Float[Tensor, " points"]:
    """Fractional Brownian motion in [-1, 1]: octaves of gradient noise, each twice as fine; differentiable in points.

    The coarsest octave has unit wavelength. The sum is divided by the sum of the octaves' strengths. With a gain of 0.5
    and whole octaves it is `svbrdfgan.weathering.noise.fbm`.

    Args:
        octaves: in (0, 32]; the last is weighted by the fraction, so that the result is continuous in `octaves`.
        gain: strength of an octave relative to the one before it.

    Raises:
        ValueError: `octaves` is out of range.
    """
    if not 0 < octaves <= MOST_OCTAVES:
        raise ValueError(f"octaves is {octaves}; wanted more than 0 and at most {MOST_OCTAVES}")
    slope = _wants_slope(points)
    value, *slopes = _computed("fbm", [points], seed, float(octaves), float(gain), slope)
    return _with_slope(points, value, slopes)


def spots(points: Float[Tensor, "points 3"], share: Float[Tensor, " points"], seed: int) -> Spots:
    """Balls at random places, one for each cell, of radius 0.125 to 0.5; `inside` is differentiable in points.

    The gradient holds `share` constant.

    Args:
        share: of the balls that are there, at each point; a ball grows from nothing as the share rises by 0.05.
    """
    inside, random, *slopes = _computed("spots", [points, share], seed, _wants_slope(points))
    return Spots(_with_slope(points, inside, slopes), random)


def streaks(plane: Float[Tensor, "points 2"], share: Float[Tensor, " points"], seed: int) -> Streaks:
    """Runs of water down a plane, one for each cell, 0.35 to 1.25 long and 0.12 to 0.56 wide; without a gradient.

    A streak narrows to half its width at its tail, and fades on the way.

    Args:
        plane: positions across, and downwards.
        share: of the streaks that are there, at each point; a streak appears as the share rises by 0.1.
    """
    return Streaks(*_computed("streaks", [plane, share], seed))


def scratches(
    points: Float[Tensor, "points 3"], normal: Float[Tensor, "points 3"], share: Float[Tensor, " points"], seed: int
) -> Scratches:
    """Bent segments, one for each cell, 0.12 to 0.8 long, seen in the surface's tangent plane; without a gradient.

    A segment weighs less the farther its centre is from the tangent plane, and where it is steep to that plane.

    Args:
        normal: of unit length.
        share: of the segments that are there, at each point; a segment appears as the share rises by 0.1.
    """
    return Scratches(*_computed("scratches", [points, normal, share], seed))


def _computed(primitive: str, inputs: list[Tensor], *options: Any) -> tuple[Tensor, ...]:
    """By the kernel where Warp is installed, else by the reference, on the CPU."""
    inputs = [each.detach().float().contiguous() for each in inputs]
    if importlib.util.find_spec("warp"):
        from svbrdfgan.weathering import noise_kernels

        computed: tuple[Tensor, ...] = getattr(noise_kernels, primitive)(*inputs, *options)
        return computed
    from svbrdfgan.weathering import noise_reference

    arrays = [each.cpu().double().numpy() for each in inputs]
    found = getattr(noise_reference, primitive)(*arrays, *options)
    return tuple(torch.from_numpy(each).to(inputs[0].device, torch.float32) for each in found)


def _wants_slope(points: Tensor) -> bool:
    return points.requires_grad and torch.is_grad_enabled()


def _with_slope(points: Tensor, value: Tensor, slopes: list[Tensor]) -> Tensor:
    if not slopes:
        return value
    attached: Tensor = _Sloped.apply(points, value, *slopes)
    return attached


class _Sloped(torch.autograd.Function):
    """A value at each point whose gradient is known."""

    @staticmethod
    def forward(ctx: Any, points: Tensor, value: Tensor, slope: Tensor) -> Tensor:
        ctx.save_for_backward(slope)
        return value

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor, None, None]:
        (slope,) = ctx.saved_tensors
        return grad[:, None] * slope, None, None
