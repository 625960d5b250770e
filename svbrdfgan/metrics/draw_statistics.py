"""The statistics of a set of draws of layers that `resemblance` compares, and for each part a distance between them.

Compared are alpha and the maps times alpha, not composites: so the score does not depend on the paint below, colours
do not count where nothing is painted, and equal distributions of these mean equal distributions over every paint.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.texture_pyramid import (
    Octave,
    octaves,
    patch_areas,
    pooled,
    premultiplied,
    premultiplied_values,
)
from svbrdfgan.types import Layer

PARTS = ("patches", "mean", "deviation", "spectrum", "joint", "amount")
"""The parts of `resemblance`."""

Draws = Layer
"""Layers of one vehicle, (draws, rows, cols, channels), as a generator paints them; two or more."""

_VISIBLE = 0.01  # deviations far below this, of values in [0, 1], do not count
_PATCH = 5
_LEAST_PATCHES = 16  # octaves in which a vehicle has fewer are left out for it
_PLACES = 32  # per side of the texture, for mean and deviation: finer ones only add noise
_QUANTILES = 256
_DEPENDENT = 0.25  # a map whose correlations have a lesser norm depends on no other
_CONSTANT = 0.005  # a map whose values have lesser deviations over all true draws is constant, as metallic 0 is
_CONSTANT_VISIBLE = 0.05  # deviations far below this, of maps that are constant in the truth, do not count


@dataclass(frozen=True, eq=False)
class ScoredSurface:
    """The texels of one vehicle on which layers are compared.

    Attributes:
        weight: area in square metres of each scored texel, zero elsewhere, as `Target.weight`.
        part: index of the part at each texel, as `GeometryBuffer.part`.
    """

    weight: Float[Tensor, "rows cols"]
    part: Int[Tensor, "rows cols"]


@dataclass(frozen=True, eq=False)
class Statistics:
    """The statistics that the parts compare; lists are of octaves.

    Attributes:
        mean, deviation: of every place of every vehicle.
        error: the expected square of the error of `mean`, from the number of draws.
        joint: for each octave and map, how the map's values in blocks of texels correlate with those of all others.
    """

    patches: list[Float[Tensor, "projections quantiles"]]
    mean: Float[Tensor, "channels places"]
    error: Float[Tensor, "channels places"]
    deviation: Float[Tensor, "channels places"]
    share: Float[Tensor, " places"]
    spectrum: Float[Tensor, "octaves channels"]
    joint: list[list[Float[Tensor, "values others"]]]
    amount: Float[Tensor, " quantiles"]


def distances(made: Statistics, truth: Statistics) -> dict[str, float]:
    """d of each part. That of `mean` is a square, without what the numbers of draws add to it.

    That of `joint` is of the map that is worst, relative to its distance if it were independent of the other maps.
    """
    mean = ((made.mean - truth.mean).square() - made.error - truth.error).mean(dim=0)
    deviation = (made.deviation - truth.deviation).square().mean(dim=0)
    power = (made.spectrum - truth.spectrum).abs() / truth.spectrum.clamp(min=_VISIBLE)
    patches = zip(made.patches, truth.patches, strict=True)
    found = {
        "patches": torch.stack([(a - b).abs().mean() for a, b in patches]).mean(),
        "mean": (mean * truth.share).sum(),
        "deviation": (deviation * truth.share).sum(),
        "spectrum": power.mean(),
        "joint": (_strength(made.joint, truth.joint) / _strength(truth.joint).clamp(min=_DEPENDENT)).max(),
        "amount": (made.amount - truth.amount).abs().mean(),
    }
    return {name: float(value) for name, value in found.items()}


@dataclass(frozen=True, eq=False)
class Measure:
    """A measure of any stack of draws: the same places, patches and directions, in the truth's units.

    Attributes:
        patches: for each vehicle and octave, which patches are compared; the same number, or None.
        scale: the deviation of each value over all true draws.
        factors: what values are multiplied by before anything else: 1, but less for maps that the truth keeps constant,
            where errors relative to the truth's own deviation would have no bound.
        maps: which values belong to each map; alpha is no map. Maps that the truth keeps constant are left out, since
            they depend on no other: what a generator paints there counts in the other parts, and as what other maps
            should not correlate with.
        details: for each octave, what makes the true details uncorrelated.
        blocks: for each octave, the covariance of the true blocks.
        directions: for each octave, what patches are projected on.
    """

    surfaces: Sequence[ScoredSurface]
    patches: list[list[Int[Tensor, " patches"] | None]]
    scale: Float[Tensor, " channels"]
    factors: Float[Tensor, " channels"]
    maps: list[Int[Tensor, " channels"]]
    details: list[Float[Tensor, "channels channels"]]
    blocks: list[Float[Tensor, "values values"] | None]
    directions: list[Float[Tensor, "values projections"]]

    @classmethod
    def make(
        cls,
        surfaces: Sequence[ScoredSurface],
        truth: Sequence[Draws],
        seed: int,
        count: int = 192,
        projections: int = 128,
    ) -> Measure:
        rng = torch.Generator().manual_seed(seed)  # of the CPU, so that all devices compare the same
        patches = [_choose_patches(surface, count, rng) for surface in surfaces]
        if all(chosen is None for each in patches for chosen in each):
            raise AssetError(f"no patch of {_PATCH} x {_PATCH} scored texels lies on one part: use finer textures.")
        found = [_variance(draws, surface) for draws, surface in zip(truth, surfaces, strict=True)]
        variance = torch.stack(found).mean(dim=0)
        maps = _map_values(truth[0].maps)
        varying = [values for values in maps if variance[values].max() > _CONSTANT**2] or maps
        factors = torch.full_like(variance, _VISIBLE / _CONSTANT_VISIBLE)
        factors[torch.cat([torch.zeros(1, dtype=torch.long), *varying])] = 1.0
        pyramids = [_octaves(draws, surface, factors) for draws, surface in zip(truth, surfaces, strict=True)]
        channels, levels = pyramids[0][0].values.shape[1], len(pyramids[0])
        size = (_PATCH * _PATCH * channels, projections)
        directions = [F.normalize(torch.randn(size, generator=rng), dim=0) for _ in range(levels)]
        return cls(
            surfaces,
            patches,
            (variance * factors.square() + _VISIBLE**2).sqrt(),
            factors,
            varying,
            [_whitening(_second_moments([_details(p[n]) for p in pyramids])) for n in range(levels)],
            [_covariance([p[n].blocks() for p in pyramids]) for n in range(levels)],
            [each.to(variance) for each in directions],
        )

    def statistics(self, stacks: Sequence[Draws]) -> Statistics:
        pyramids = [_octaves(*each, self.factors) for each in zip(stacks, self.surfaces, strict=True)]
        levels, each = range(len(pyramids[0])), len(pyramids)
        places = [self._places(pyramid[0]) for pyramid in pyramids]
        mean, error, deviation, share = (torch.cat(values, dim=-1) for values in zip(*places, strict=True))
        spectrum = torch.stack([torch.stack([p[n].power() for p in pyramids]).mean(dim=0) for n in levels])
        amounts = [_surface_mean(p[0].values[:, :1], p[0].weight) for p in pyramids]
        return Statistics(
            patches=[values for n in levels if (values := self._patches(pyramids, n)) is not None],
            mean=mean,
            error=error,
            deviation=deviation,
            share=share / each,
            spectrum=spectrum.sqrt(),
            joint=[self._correlations(pyramids, n) for n in levels if self.blocks[n] is not None],
            amount=_quantiles(torch.cat(amounts).flatten()),
        )

    def _places(self, finest: Octave) -> tuple[Tensor, ...]:
        """Mean over draws, its expected squared error, and deviation at each place, and the place's share of the area.

        Means are relative to each draw's own over the surface: how much it paints is judged by the part `amount`.
        """
        values, weight, draws = finest.values / self.scale[:, None, None], finest.weight, len(finest.values)
        relative = values - _surface_mean(values, weight)[..., None, None]
        variance = values.var(dim=0, correction=min(1, draws - 1))[None]
        while min(weight.shape) > _PLACES and weight.shape[0] % 2 == weight.shape[1] % 2 == 0:
            relative, variance = (pooled(each, weight) for each in (relative, variance))
            weight = F.avg_pool2d(weight[None], 2)[0]
        mean, error = relative.mean(dim=0), relative.var(dim=0, correction=min(1, draws - 1)) / draws
        there = weight > 0
        share = weight[there] / weight.sum()
        return mean[:, there], error[:, there], variance[0][:, there].sqrt(), share

    def _correlations(self, pyramids: list[list[Octave]], n: int) -> list[Float[Tensor, "values others"]]:
        """The correlations of each map's values in a block with all other values there, both whitened by the truth."""
        found, truth = _covariance([p[n].blocks() for p in pyramids]), self.blocks[n]
        assert found is not None
        assert truth is not None
        made = []
        for channels in self.maps:
            own = torch.zeros(len(found) // 4, 4, dtype=torch.bool)
            own[channels] = True
            a, b = (mask.to(found.device) for mask in (own.flatten(), ~own.flatten()))
            made.append(_whitening(truth[a][:, a]) @ found[a][:, b] @ _whitening(truth[b][:, b]))
        return made

    def _patches(self, pyramids: list[list[Octave]], n: int) -> Float[Tensor, "projections quantiles"] | None:
        """Quantiles of the octave's patches along each direction; None if it has too few patches."""
        found = []
        for pyramid, chosen in zip(pyramids, self.patches, strict=True):
            places = chosen[n]
            if places is not None:
                white = torch.einsum("xy,nyrc->nxrc", self.details[n], pyramid[n].detail)
                patches = F.unfold(white, _PATCH)[:, :, places.to(white.device)]
                found.append((patches.transpose(1, 2) @ self.directions[n]).flatten(0, 1))
        return _quantiles(torch.cat(found).T) if found else None


def _octaves(draws: Draws, surface: ScoredSurface, factors: Float[Tensor, " channels"]) -> list[Octave]:
    return octaves(premultiplied(draws) * factors[:, None, None], surface.weight.to(draws.values.device))


def _choose_patches(surface: ScoredSurface, count: int, rng: torch.Generator) -> list[Int[Tensor, " patches"] | None]:
    """Patches of each octave, drawn by area; None where there are too few."""
    areas = patch_areas(surface.part.cpu(), surface.weight.cpu(), _PATCH)
    return [
        torch.multinomial(area, count, replacement=True, generator=rng) if (area > 0).sum() >= _LEAST_PATCHES else None
        for area in areas
    ]


def _surface_mean(
    values: Float[Tensor, "draws channels rows cols"], weight: Float[Tensor, "rows cols"]
) -> Float[Tensor, "draws channels"]:
    return (values * (weight / weight.sum())).sum(dim=(2, 3))


def _variance(draws: Draws, surface: ScoredSurface) -> Float[Tensor, " channels"]:
    """The variance over surface and draws."""
    values, weight = premultiplied(draws), surface.weight.to(draws.values.device)
    mean, square = (_surface_mean(x, weight).mean(dim=0) for x in (values, values.square()))
    return (square - mean.square()).clamp(min=0.0)


def _details(octave: Octave) -> tuple[Float[Tensor, "draws texels channels"], Float[Tensor, " texels"]]:
    inside = octave.weight > 0
    return octave.detail[:, :, inside].transpose(1, 2), octave.weight[inside]


def _covariance(samples: Sequence[tuple[Tensor, Tensor]]) -> Float[Tensor, "values values"] | None:
    """`_second_moments` of the vehicles that have samples; None if none has."""
    found = [(values, weight) for values, weight in samples if len(weight)]
    return _second_moments(found) if found else None


def _second_moments(samples: Sequence[tuple[Tensor, Tensor]]) -> Float[Tensor, "values values"]:
    """Mean products of values whose means are zero: of draws x samples x values with weights, over the vehicles."""
    products = [
        torch.einsum("nsx,nsy->xy", values * weight[:, None], values) / (len(values) * weight.sum())
        for values, weight in samples
    ]
    return torch.stack(products).mean(dim=0)


def _map_values(maps: tuple[str, ...]) -> list[Int[Tensor, " channels"]]:
    """The values of `premultiplied` that belong to each map of a layer, base_color first."""
    counts = [premultiplied_values(name) for name in ("base_color", *maps)]
    return [*torch.arange(1, 1 + sum(counts)).split(counts)]


def _strength(made: list[list[Tensor]], truth: list[list[Tensor]] | None = None) -> Float[Tensor, " maps"]:
    """The norm of each map's correlations, or of their difference to the true ones; the mean over octaves."""
    differences = (
        made
        if truth is None
        else [[a - b for a, b in zip(*octave, strict=True)] for octave in zip(made, truth, strict=True)]
    )
    return torch.stack([torch.stack([each.norm() for each in octave]) for octave in differences]).mean(dim=0)


def _whitening(covariance: Float[Tensor, "values values"]) -> Float[Tensor, "values values"]:
    """The inverse square root of a covariance to which invisible noise was added."""
    variances, axes = torch.linalg.eigh(covariance)
    return axes @ torch.diag((variances.clamp(min=0.0) + _VISIBLE**2).rsqrt()) @ axes.T


def _quantiles(values: Float[Tensor, "*batch samples"]) -> Float[Tensor, "*batch quantiles"]:
    """Evenly spaced quantiles, interpolated, so that sets of any size can be compared."""
    ordered, last = values.sort(dim=-1).values, values.shape[-1] - 1
    at = ((torch.arange(_QUANTILES, device=values.device) + 0.5) / _QUANTILES * (last + 1) - 0.5).clamp(0, last)
    low = at.long()
    return torch.lerp(ordered[..., low], ordered[..., (low + 1).clamp(max=last)], (at - low).to(values.dtype))
