"""Estimates the light of a picture of a mesh whose base material is known.

Under direct light an image of Lambertian surfaces is linear in the environment. The environment is modelled as the mean
light of the pool times a weighted sum of smooth lobes, with non-negative weights for each channel, which are fitted to
the picture. An unknown share of each pixel is weathered: its reflectance is a mixture of its base colour and that of
dirt. Residuals count by their absolute value, not by their square. Both colours are raised a little, since paint that
is not matt reflects more. Lobes that the picture does not determine, such as those behind the camera's subject, stay
near the mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import nnls
from torch import Tensor

from svbrdfgan.data.photos.overlay import downsample
from svbrdfgan.errors import AssetError
from svbrdfgan.types import Material, Materials, Rendering

SIDE = 64
"""Pixels, at most, along the longer side of the image that light is estimated from: smooth light needs no more."""

LOBES = 96
_SHARPNESS = 14.0
GLOSS = 0.02
"""The reflectance that gloss adds under smooth light."""

_RIDGE = 0.03
"""Weight of the penalty on the distance from the prior, against a mean of squares of residuals."""
_ROUNDS = 8
"""Rounds of reweighted least squares."""
_SMALL = 0.05
"""Residual, relative to the clean image, below which squares count."""
_DARK = 0.3
"""Share of the clean image's median that is added to it for `_SMALL`: else the darkest pixels would dominate."""

_FULL = 0.9
"""Coverage from which a pixel counts as filled."""
_LEAST = 20
"""Filled pixels that are needed."""

Light = Float[Tensor, "rows cols 3"]
Render = Callable[[Materials, Light], Rendering]
"""The image of these materials under this light."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """The pixels of a picture that learnable parts fill.

    Attributes:
        radiance: of the picture.
        base: reflectance of the unweathered mesh.
        white: radiance of a white mesh under each lobe of the mean light.
    """

    radiance: Float[ndarray, "pixels 3"]
    base: Float[ndarray, "pixels 3"]
    white: Float[ndarray, "pixels 3 lobes"]


def evidence_size(width: int, height: int) -> tuple[int, int]:
    """Width and height of the images that `gather_evidence` renders."""
    shrink = min(1.0, SIDE / max(width, height))
    return max(1, round(width * shrink)), max(1, round(height * shrink))


def gather_evidence(
    photo: Rendering, render: Render, clean: Materials, learnable: Sequence[int], mean: Light
) -> Evidence:
    """The evidence of a picture.

    Args:
        photo: the picture, premultiplied by its mask.
        render: makes images from the same camera, of `evidence_size`.
        clean: the unweathered mesh's materials.
        learnable: its parts that may be weathered.
        mean: the mean light of the pool.

    Raises:
        AssetError: the picture shows too little of learnable parts.
    """
    alone, bare = white(range(len(clean)), len(clean)), white(learnable, len(clean))
    lit = torch.stack([render(bare, mean * lobe.unsqueeze(-1)).image for lobe in lobes(*mean.shape[:2])], dim=-1)
    full, even, rendered = lit.sum(dim=-1), torch.ones_like(mean), render(clean, mean)
    planes = torch.cat([photo.image, photo.coverage.unsqueeze(-1)], dim=-1).permute(2, 0, 1)
    *colors, coverage = downsample(planes, (lit.shape[1], lit.shape[0]))
    image = torch.stack(colors, dim=-1)
    usable = torch.minimum(coverage, rendered.coverage) > _FULL
    # learnable parts must fill a pixel nearly alone, which white materials under even light show
    usable &= (render(bare, even).image > _FULL * render(alone, even).image).all(dim=-1) & (full > 0).all(dim=-1)
    if int(usable.sum()) < _LEAST:
        raise AssetError(
            "it shows too little of its learnable parts to estimate its light: name its 'environment', or set "
            "'light: mean'."
        )
    base = rendered.image[usable] / full[usable]
    return Evidence(*(part.double().numpy() for part in (image[usable], base, lit[usable])))


def lobes(rows: int, cols: int) -> Float[Tensor, "lobes rows cols"]:
    """Smooth lobes, spread evenly over the sphere, whose sum is one everywhere."""
    polar = (torch.arange(rows) + 0.5) / rows * math.pi
    around = 2 * math.pi * ((torch.arange(cols) + 0.5) / cols - 0.5)
    height = 1 - 2 * (torch.arange(LOBES) + 0.5) / LOBES
    golden = math.pi * (1 + math.sqrt(5)) * torch.arange(LOBES)
    pixels = _directions(torch.cos(polar)[:, None], around[None])
    return torch.softmax(_SHARPNESS * pixels @ _directions(height, golden).T, dim=-1).permute(2, 0, 1)


def environment(mean: Light, weights: Float[ndarray, "3 lobes"]) -> Light:
    """The mean light, multiplied in each lobe by its weight."""
    return mean * torch.einsum("cl,lrw->rwc", torch.from_numpy(weights).float(), lobes(*mean.shape[:2]))


def estimate_weights(evidence: Evidence, dirt: tuple[float, float, float]) -> Float[ndarray, "3 lobes"]:
    """The weight of each lobe in each channel; 1 is as bright as in the mean light.

    Args:
        dirt: approximate linear reflectance of the layer that weathering adds.
    """
    base, laid = evidence.base + GLOSS, np.asarray(dirt) - evidence.base
    bright = (evidence.base * evidence.white.sum(axis=-1)).mean(axis=-1, keepdims=True)
    unit = bright + _DARK * np.median(bright)
    radiance, white = evidence.radiance / unit, evidence.white / unit[..., None]
    weights = np.ones((3, white.shape[-1]))
    for done in range(_ROUNDS):
        lit = np.einsum("pcl,cl->pc", white, weights)
        share = _shares(radiance - lit * base, lit * laid) * (0.5 if done == 0 else 1.0)
        color = base + share * laid
        off = np.abs(radiance - lit * color).mean(axis=-1)
        weights = _solve(radiance, white * color[..., None], 1 / np.maximum(off, _SMALL))
    return weights


def _shares(wanted: Float[ndarray, "pixels 3"], change: Float[ndarray, "pixels 3"]) -> Float[ndarray, "pixels 1"]:
    """The share of the change that fits each pixel best by least squares, in [0, 1]."""
    square = (change * change).sum(axis=-1, keepdims=True)
    return np.clip((wanted * change).sum(axis=-1, keepdims=True) / np.maximum(square, 1e-12), 0, 1)


def _solve(
    radiance: Float[ndarray, "pixels 3"], seen: Float[ndarray, "pixels 3 lobes"], trust: Float[ndarray, " pixels"]
) -> Float[ndarray, "3 lobes"]:
    """Weights by least squares: of grey light, regularised to one; then of each channel, regularised to the grey."""
    count = seen.shape[-1]
    trust = trust / trust.sum()
    grey = _nearest(radiance.reshape(-1), seen.reshape(-1, count), np.repeat(trust / 3, 3), np.ones(count))
    return np.stack([_nearest(radiance[:, c], seen[:, c], trust, grey) for c in range(3)])


def _nearest(
    radiance: Float[ndarray, " rows"],
    seen: Float[ndarray, "rows lobes"],
    trust: Float[ndarray, " rows"],
    prior: Float[ndarray, " lobes"],
) -> Float[ndarray, " lobes"]:
    """Non-negative least squares, weighted by trust, with a ridge penalty on the distance from the prior."""
    weighted, ridge = seen * trust[:, None], _RIDGE / len(prior)
    factor = np.linalg.cholesky(weighted.T @ seen + ridge * np.eye(len(prior)))
    return nnls(factor.T, np.linalg.solve(factor, weighted.T @ radiance + ridge * prior))[0]


def white(parts: Iterable[int], count: int) -> Materials:
    """Materials with these parts white and all others black."""
    chosen = set(parts)
    return Materials(tuple(Material.lambertian((float(part in chosen),) * 3) for part in range(count)))


def _directions(height: Float[Tensor, "*shape"], around: Float[Tensor, "*other"]) -> Float[Tensor, "*both 3"]:
    """Unit vectors with this Y, at this angle from -Z towards +X."""
    flat = (1 - height * height).sqrt()
    height = height.expand(torch.broadcast_shapes(height.shape, around.shape))
    return torch.stack([flat * torch.sin(around), height, -flat * torch.cos(around)], dim=-1)
