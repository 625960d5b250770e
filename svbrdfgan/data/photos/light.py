"""The light of a picture, from what it shows of a mesh whose base material is known.

Under direct light a picture of Lambertian surfaces is linear in the environment. That is sought as the mean light of
the pool times a sum of smooth lobes. Their weights, none of them negative, a picture tells for each channel. An unknown
part of it is weathered: a pixel's reflectance may be any mixture of its base colour and of that of dirt. What this does
not explain weighs by its absolute value, not by its square. Both colours are raised a little, since paint that is not
matt adds a veil of light. What a picture does not tell, such as the light behind what it shows, stays near the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import nnls
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.types import Material, Materials, Rendering

SIDE = 64
"""Pixels along a picture's longer side, at most, from which its light is told: smooth light needs no more."""

LOBES = 96
_SHARPNESS = 14.0
GLOSS = 0.02
"""What paint that is not matt adds to its reflectance, seen so smoothly."""

_RIDGE, _ROUNDS = 0.03, 8
_SMALL, _DARK = 0.05, 0.3
"""A difference, relative to the clean picture, below which squares count; and what is added to the clean picture for
that, relative to its median, lest the darkest pixels decide."""

_FULL, _LEAST = 0.9, 20

Light = Float[Tensor, "rows cols 3"]
Shoot = Callable[[Materials, Light], Rendering]
"""The picture of these materials under this light."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a picture tells of its light, at the pixels that learnable parts fill.

    Attributes:
        taken: their radiance.
        base: the reflectance of the unweathered mesh there.
        white: their radiance under each lobe of the mean light, were they white.
    """

    taken: Float[ndarray, "pixels 3"]
    base: Float[ndarray, "pixels 3"]
    white: Float[ndarray, "pixels 3 lobes"]


def film_size(width: int, height: int) -> tuple[int, int]:
    """Width and height of the pictures that `look` wants shot."""
    shrink = min(1.0, SIDE / max(width, height))
    return max(1, round(width * shrink)), max(1, round(height * shrink))


def look(taken: Rendering, shoot: Shoot, clean: Materials, learnable: Sequence[int], mean: Light) -> Evidence:
    """What a picture tells of its light.

    Args:
        taken: the picture, premultiplied by its mask.
        shoot: makes pictures from the same camera, of `film_size`.
        clean: the unweathered mesh's materials.
        learnable: its parts that may be weathered.
        mean: the mean light of the pool.

    Raises:
        AssetError: too little of learnable parts is seen to tell.
    """
    alone, bare = white(range(len(clean)), len(clean)), white(learnable, len(clean))
    lit = torch.stack([shoot(bare, mean * lobe.unsqueeze(-1)).image for lobe in lobes(*mean.shape[:2])], dim=-1)
    full, even, shot = lit.sum(dim=-1), torch.ones_like(mean), shoot(clean, mean)
    image, coverage = _shrunk(taken, (lit.shape[1], lit.shape[0]))
    told = torch.minimum(coverage, shot.coverage) > _FULL
    told &= (shoot(bare, even).image > _FULL * shoot(alone, even).image).all(dim=-1) & (full > 0).all(dim=-1)
    if int(told.sum()) < _LEAST:
        raise AssetError(
            "too little of its learnable parts is seen to tell its light: name its 'environment', or set 'light: mean'."
        )
    base = shot.image[told] / full[told]
    return Evidence(*(part.double().numpy() for part in (image[told], base, lit[told])))


def lobes(rows: int, cols: int) -> Float[Tensor, "lobes rows cols"]:
    """Smooth bumps all over the sphere, whose sum is one everywhere."""
    polar = (torch.arange(rows) + 0.5) / rows * math.pi
    around = 2 * math.pi * ((torch.arange(cols) + 0.5) / cols - 0.5)
    height = 1 - 2 * (torch.arange(LOBES) + 0.5) / LOBES
    golden = math.pi * (1 + math.sqrt(5)) * torch.arange(LOBES)
    pixels = _directions(torch.cos(polar)[:, None], around[None])
    return torch.softmax(_SHARPNESS * pixels @ _directions(height, golden).T, dim=-1).permute(2, 0, 1)


def light(mean: Light, weights: Float[ndarray, "3 lobes"]) -> Light:
    """The mean light, as many times as bright in each lobe as the weights say."""
    return mean * torch.einsum("cl,lrw->rwc", torch.from_numpy(weights).float(), lobes(*mean.shape[:2]))


def estimate(evidence: Evidence, dirt: tuple[float, float, float]) -> Float[ndarray, "3 lobes"]:
    """Each lobe's weight in each channel: one where it is as in the mean light.

    Args:
        dirt: linear reflectance of whatever weathering lays on paint, roughly.
    """
    base, laid = evidence.base + GLOSS, np.asarray(dirt) - evidence.base
    bright = (evidence.base * evidence.white.sum(axis=-1)).mean(axis=-1, keepdims=True)
    unit = bright + _DARK * np.median(bright)
    taken, white = evidence.taken / unit, evidence.white / unit[..., None]
    weights = np.ones((3, white.shape[-1]))
    for done in range(_ROUNDS):
        lit = np.einsum("pcl,cl->pc", white, weights)
        share = _shares(taken - lit * base, lit * laid) * (0.5 if done == 0 else 1.0)
        color = base + share * laid
        off = np.abs(taken - lit * color).mean(axis=-1)
        weights = _solve(taken, white * color[..., None], 1 / np.maximum(off, _SMALL))
    return weights


def _shares(wanted: Float[ndarray, "pixels 3"], change: Float[ndarray, "pixels 3"]) -> Float[ndarray, "pixels 1"]:
    """How much of the change each pixel wants, least squares, in [0, 1]."""
    square = (change * change).sum(axis=-1, keepdims=True)
    return np.clip((wanted * change).sum(axis=-1, keepdims=True) / np.maximum(square, 1e-12), 0, 1)


def _solve(
    taken: Float[ndarray, "pixels 3"], seen: Float[ndarray, "pixels 3 lobes"], trust: Float[ndarray, " pixels"]
) -> Float[ndarray, "3 lobes"]:
    """Weights of least squares: those of grey light first, near one; then those of each channel, near these."""
    count = seen.shape[-1]
    trust = trust / trust.sum()
    grey = _nearest(taken.reshape(-1), seen.reshape(-1, count), np.repeat(trust / 3, 3), np.ones(count))
    return np.stack([_nearest(taken[:, c], seen[:, c], trust, grey) for c in range(3)])


def _nearest(
    taken: Float[ndarray, " rows"],
    seen: Float[ndarray, "rows lobes"],
    trust: Float[ndarray, " rows"],
    prior: Float[ndarray, " lobes"],
) -> Float[ndarray, " lobes"]:
    """The least trust-weighted squares and, times the ridge, those of the distance from the prior; not negative."""
    weighed, ridge = seen * trust[:, None], _RIDGE / len(prior)
    square = np.linalg.cholesky(weighed.T @ seen + ridge * np.eye(len(prior)))
    return nnls(square.T, np.linalg.solve(square, weighed.T @ taken + ridge * prior))[0]


def white(parts: Iterable[int], count: int) -> Materials:
    """These parts in white, all others in black."""
    named = set(parts)
    return Materials(tuple(Material.lambertian((float(part in named),) * 3) for part in range(count)))


def _directions(height: Float[Tensor, "*shape"], around: Float[Tensor, "*other"]) -> Float[Tensor, "*both 3"]:
    """Unit vectors by their Y and their angle from -Z towards +X."""
    flat = (1 - height * height).sqrt()
    height = height.expand(torch.broadcast_shapes(height.shape, around.shape))
    return torch.stack([flat * torch.sin(around), height, -flat * torch.cos(around)], dim=-1)


def _shrunk(taken: Rendering, size: tuple[int, int]) -> tuple[Tensor, Tensor]:
    planes = torch.cat([taken.image, taken.coverage.unsqueeze(-1)], dim=-1).permute(2, 0, 1)
    small = F.adaptive_avg_pool2d(planes, (size[1], size[0]))
    return small[:3].permute(1, 2, 0), small[3]
