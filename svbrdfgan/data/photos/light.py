"""Estimates the light of pictures of meshes whose base material is known.

Under direct light an image of Lambertian surfaces is linear in the environment. The environment is modelled as the mean
light of the pool times a weighted sum of smooth lobes, with non-negative weights for each channel, which are fitted to
the picture. An unknown share of each pixel is weathered: its reflectance is a mixture of its base colour and that of
dirt. Once a model has learned the weathering, it is the mean of what the model paints there. Residuals count by their
absolute value, not by their square. Reflectances are raised a little, since paint that is not matt reflects more. Lobes
that the picture does not determine, such as those behind the camera's subject, stay near the mean. Pictures in one
light are fitted together, each with an unknown exposure.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
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
"""Weight of the penalties on how far lobes and gains are from 1, against a picture's mean of squares of residuals."""
_TINT = 0.3
"""Weight, in the same units, of the penalty on how far the mean of each channel is from that in grey light: else paint
that dust makes grey would be taken for light of the complementary colour."""
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
        usable: where they are in the picture.
        draws: reflectance of the mesh in weatherings that are likely; there may be none.
    """

    radiance: Float[ndarray, "pixels 3"]
    base: Float[ndarray, "pixels 3"]
    white: Float[ndarray, "pixels 3 lobes"]
    usable: Bool[ndarray, "rows cols"]
    draws: Float[ndarray, "draws pixels 3"]

    def thinned(self, most: int) -> Evidence:
        """At most about so many of the pixels, spread evenly."""
        step = math.ceil(len(self.radiance) / most)
        usable = np.zeros_like(self.usable)
        usable.flat[np.flatnonzero(self.usable)[::step]] = True
        radiance, base, white = (part[::step].copy() for part in (self.radiance, self.base, self.white))
        return Evidence(radiance, base, white, usable, self.draws[:, ::step].copy())


def evidence_size(width: int, height: int) -> tuple[int, int]:
    """Width and height of the images that `gather_evidence` renders."""
    shrink = min(1.0, SIDE / max(width, height))
    return max(1, round(width * shrink)), max(1, round(height * shrink))


def gather_evidence(
    photo: Rendering,
    render: Render,
    clean: Materials,
    learnable: Sequence[int],
    mean: Light,
    weathered: Sequence[Materials] = (),
) -> Evidence:
    """The evidence of a picture.

    Args:
        photo: the picture, premultiplied by its mask.
        render: makes images from the same camera, of `evidence_size`.
        clean: the unweathered mesh's materials.
        learnable: its parts that may be weathered.
        mean: the mean light of the pool.
        weathered: the mesh's materials in weatherings that are likely.

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
    light = full[usable]
    radiance, base, shown = (
        part.double().numpy() for part in (image[usable], rendered.image[usable] / light, lit[usable])
    )
    draws = [(render(materials, mean).image[usable] / light).double().numpy() for materials in weathered]
    return Evidence(radiance, base, shown, usable.numpy(), np.array(draws).reshape(-1, *base.shape))


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


@dataclass(frozen=True, eq=False)
class Estimate:
    """The light of pictures.

    Attributes:
        weights: of each lobe in each channel; 1 is as bright as in the mean light.
        gains: the factor on each picture's radiance that fits the light; their geometric mean is 1.
        shares: how much of each pixel is weathered, in [0, 1]; the pixels of all pictures.
    """

    weights: Float[ndarray, "3 lobes"]
    gains: Float[ndarray, " pictures"]
    shares: Float[ndarray, "pixels 1"]


def estimate_light(pictures: Sequence[Evidence], dirt: tuple[float, float, float]) -> Estimate:
    """The light that all of these pictures show.

    Args:
        dirt: approximate linear reflectance of the layer that weathering adds.
    """
    which = np.repeat(np.arange(len(pictures)), [len(evidence.radiance) for evidence in pictures])
    shown, white = (np.concatenate(parts) for parts in zip(*map(_in_units, pictures), strict=True))
    parts = [_mixture(evidence, np.asarray(dirt)) for evidence in pictures]
    albedo, laid = (np.concatenate(each) for each in zip(*parts, strict=True))
    base = albedo + GLOSS
    weights, gains = np.ones((3, white.shape[-1])), np.ones(len(pictures))
    ridge = _RIDGE / len(pictures) / white.shape[-1]
    for done in range(_ROUNDS):
        radiance = shown * gains[which, None]
        lit = np.einsum("pcl,cl->pc", white, weights)
        share = _shares(radiance - lit * base, lit * laid) * (0.5 if done == 0 else 1.0)
        color = base + share * laid
        trust = 1 / np.maximum(np.abs(radiance - lit * color).mean(axis=-1), _SMALL)
        seen, trust = white * color[..., None], trust / trust.sum()
        if len(pictures) > 1:
            gains = _gains(which, shown, seen, trust, ridge)
        weights = _solve(shown * gains[which, None], seen, trust, ridge)
    return Estimate(weights, gains, share)


def _mixture(
    evidence: Evidence, dirt: Float[ndarray, " 3"]
) -> tuple[Float[ndarray, "pixels 3"], Float[ndarray, "pixels 3"]]:
    """Two reflectances that each pixel's is between: the first, and the other less the first.

    Where draws of a model say what to expect, both are their mean: the share of each pixel is no longer free, since it
    would take up the picture's exposure.
    """
    if len(evidence.draws):
        return evidence.draws.mean(axis=0), np.zeros_like(evidence.base)
    return evidence.base, dirt - evidence.base


def _in_units(evidence: Evidence) -> tuple[Float[ndarray, "pixels 3"], Float[ndarray, "pixels 3 lobes"]]:
    """Radiance and white radiance, both relative to the clean image under the mean light."""
    bright = (evidence.base * evidence.white.sum(axis=-1)).mean(axis=-1, keepdims=True)
    unit = bright + _DARK * np.median(bright)
    return evidence.radiance / unit, evidence.white / unit[..., None]


def _gains(
    which: Int[ndarray, " pixels"],
    shown: Float[ndarray, "pixels 3"],
    seen: Float[ndarray, "pixels 3 lobes"],
    trust: Float[ndarray, " pixels"],
    ridge: float,
) -> Float[ndarray, " pictures"]:
    """The gain of each picture by which all fit one grey light best; their geometric mean is 1.

    The best gain of a picture is linear in the light, so that least squares over both are least squares over the light.
    Gains, too, are held near 1, since lobes that one picture alone shows can take the place of its gain.
    """
    count = int(which[-1]) + 1
    weighted = seen * trust[:, None, None]
    products = np.zeros((count, seen.shape[-1]))
    np.add.at(products, which, np.einsum("pcl,pc->pl", weighted, shown))
    held = _RIDGE / count
    squares = np.bincount(which, trust * (shown * shown).sum(axis=-1)) + held
    left = np.tensordot(weighted, seen, axes=([0, 1], [0, 1])) - products.T @ (products / squares[:, None])
    right = products.T @ (held / squares)
    light = _positive(left, right, np.ones(seen.shape[-1]), ridge)
    gains = np.maximum((products @ light + held) / squares, 1e-6)
    return gains / math.exp(np.log(gains).mean())


def _shares(wanted: Float[ndarray, "pixels 3"], change: Float[ndarray, "pixels 3"]) -> Float[ndarray, "pixels 1"]:
    """The share of the change that fits each pixel best by least squares, in [0, 1]."""
    square = (change * change).sum(axis=-1, keepdims=True)
    return np.clip((wanted * change).sum(axis=-1, keepdims=True) / np.maximum(square, 1e-12), 0, 1)


def _solve(
    radiance: Float[ndarray, "pixels 3"],
    seen: Float[ndarray, "pixels 3 lobes"],
    trust: Float[ndarray, " pixels"],
    ridge: float,
) -> Float[ndarray, "3 lobes"]:
    """Weights by least squares: of grey light, regularised to one; then of each channel, regularised to the grey.

    The mean of each channel is held to that in grey light more than its lobes are.
    """
    weighted = seen * trust[:, None, None]
    squares = [weighted[:, c].T @ seen[:, c] for c in range(3)]
    products = [weighted[:, c].T @ radiance[:, c] for c in range(3)]
    grey = _positive(sum(squares) / 3, sum(products) / 3, np.ones(seen.shape[-1]), ridge)
    weights = []
    for square, product, mean in zip(squares, products, weighted.sum(axis=0), strict=True):
        held = square + _TINT / max(float(mean @ grey), 1e-9) * np.outer(mean, mean)
        weights.append(_positive(held, product + _TINT * mean, grey, ridge))
    return np.stack(weights)


def _positive(
    squares: Float[ndarray, "lobes lobes"],
    products: Float[ndarray, " lobes"],
    prior: Float[ndarray, " lobes"],
    ridge: float,
) -> Float[ndarray, " lobes"]:
    """Non-negative least squares from its normal equations, with a ridge penalty on the distance from the prior."""
    factor = np.linalg.cholesky(squares + ridge * np.eye(len(prior)))
    return nnls(factor.T, np.linalg.solve(factor, products + ridge * prior))[0]


def white(parts: Iterable[int], count: int) -> Materials:
    """Materials with these parts white and all others black."""
    chosen = set(parts)
    return Materials(tuple(Material.lambertian((float(part in chosen),) * 3) for part in range(count)))


def _directions(height: Float[Tensor, "*shape"], around: Float[Tensor, "*other"]) -> Float[Tensor, "*both 3"]:
    """Unit vectors with this Y, at this angle from -Z towards +X."""
    flat = (1 - height * height).sqrt()
    height = height.expand(torch.broadcast_shapes(height.shape, around.shape))
    return torch.stack([flat * torch.sin(around), height, -flat * torch.cos(around)], dim=-1)
