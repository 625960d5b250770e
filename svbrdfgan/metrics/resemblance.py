"""The score of a generator with chance, `resemblance`: how alike its draws of layers are to draws of the true ones.

Draws are compared as sets, by six parts that see different faults. Each part is a distance d, made a skill score by
`1 - (d(generator, truth) - d(truth', truth)) / (d(constant, truth) - d(truth', truth))`, where truth' is another set of
true draws. 1 is as close as other true draws are, 0 no closer than one constant layer. `resemblance` is the geometric
mean of the parts, each clipped to [0, 1].

Compared are alpha and the maps times alpha, not composites: so the score does not depend on the paint below, colours
do not count where nothing is painted, and equal distributions of these mean equal distributions over every paint.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.texture_pyramid import Octave, octave_count, octaves, patch_areas, pooled, premultiplied

Draws = Float[Tensor, "draws rows cols channels"]
"""Layers of one vehicle, row 0 at v = 0, as a generator paints them; two or more."""

_VISIBLE = 0.01  # deviations far below this, of values in [0, 1], do not count
_PATCH = 5
_LEAST_PATCHES = 16  # octaves with fewer patches on all vehicles are left out
_PLACES = 32  # per side of the texture, for mean and deviation: finer ones only add noise
_QUANTILES = 256


class Resemblance(StrictModel):
    """How alike draws of layers are to true ones.

    Attributes:
        patches: patches of all maps, in every octave.
        mean: the mean over draws at each place, relative to that over the surface.
        deviation: the standard deviation over draws at each place.
        spectrum: power of alpha and of each map in each octave.
        joint: covariances of all maps within blocks of texels, in each octave.
        amount: mean alpha over the surface.
        draws: the generator's draws of each vehicle.

    All parts are skill scores: 1 is as close as other true draws, 0 is a constant layer. They are not clipped, so chance
    may bring them above 1.
    """

    patches: float
    mean: float
    deviation: float
    spectrum: float
    joint: float
    amount: float
    subjects: int
    draws: int

    @property
    def parts(self) -> dict[str, float]:
        return {name: getattr(self, name) for name in PARTS}

    @property
    def resemblance(self) -> float:
        """The geometric mean of the parts, each clipped to [0, 1]."""
        return math.prod(min(max(value, 0.0), 1.0) for value in self.parts.values()) ** (1 / len(PARTS))

    @property
    def least(self) -> str:
        """The name of the least part."""
        return min(self.parts, key=self.parts.__getitem__)

    def lines(self) -> list[str]:
        """The scores in words, one line each."""
        sets = f"{self.draws} draws of each of {self.subjects} subjects"
        parts = ", ".join(f"{name} {value:.2f}" for name, value in self.parts.items())
        return [
            f"resemblance: {self.resemblance:.3f} (least: {self.least} {self.parts[self.least]:.2f}; {sets})",
            f"parts:       {parts}",
        ]


PARTS = ("patches", "mean", "deviation", "spectrum", "joint", "amount")
"""The parts of `resemblance`."""


@dataclass(frozen=True, eq=False)
class ScoredSurface:
    """Where the layers of one vehicle are compared.

    Attributes:
        weight: area in square metres of each scored texel, zero elsewhere, as `Target.weight`.
        part: index of the part at each texel, as `GeometryBuffer.part`.
    """

    weight: Float[Tensor, "rows cols"]
    part: Int[Tensor, "rows cols"]


@dataclass(frozen=True, eq=False)
class Resembler:
    """Scores sets of draws against a set of true draws.

    Attributes:
        truth: the statistics of the true draws.
        chance: for each part, d(truth', truth).
        constant: for each part, d(constant, truth) of the constant layer that is closest in it.
    """

    measure: _Measure
    truth: _Statistics
    chance: Mapping[str, float]
    constant: Mapping[str, float]

    @classmethod
    def make(
        cls,
        surfaces: Sequence[ScoredSurface],
        truth: Sequence[Draws],
        again: Sequence[Draws],
        constants: Float[Tensor, "candidates channels"],
        seed: int = 0,
    ) -> Resembler:
        """A scorer on the device of these tensors.

        Args:
            truth: true draws of each vehicle, of random seed and amount.
            again: other true draws, truth'; of several times as many, d(truth', truth) is the mean over as many sets.
            constants: constant layers, such as those of `best_constants`. The mean of the true draws is always tried,
                too.
            seed: selects patches and projections. Scores of one seed are comparable.

        Raises:
            AssetError: the stacks do not fit each other or the surfaces, are of one draw, or a texture cannot be halved
                twice.
        """
        _require_fit(surfaces, truth, "true")
        _require_fit(surfaces, again, "other true")
        measure = _Measure.make(surfaces, truth, seed)
        found = measure.statistics(truth)
        sets = max(1, len(again[0]) // len(truth[0]))
        chunks = [[draws.chunk(sets)[n] for draws in again] for n in range(sets)]
        layers = [*constants.to(truth[0]), _mean_layer(surfaces, truth)]
        flat = [[layer.expand(1, *surface.weight.shape, -1) for surface in surfaces] for layer in layers]
        chance = [_distances(measure.statistics(chunk), found) for chunk in chunks]
        constant = [_distances(measure.statistics(stack), found) for stack in flat]
        return cls(
            measure,
            found,
            {name: sum(d[name] for d in chance) / sets for name in PARTS},
            {name: min(d[name] for d in constant) for name in PARTS},
        )

    def score(self, generated: Sequence[Draws]) -> Resemblance:
        """How alike a generator's draws are, one stack for each vehicle.

        Raises:
            AssetError: the stacks do not fit the surfaces or are of one draw.
        """
        _require_fit(self.measure.surfaces, generated, "generated")
        found = _distances(self.measure.statistics(generated), self.truth)
        parts = {name: self._skill(name, found[name]) for name in PARTS}
        return Resemblance(**parts, subjects=len(generated), draws=len(generated[0]))

    def _skill(self, name: str, distance: float) -> float:
        room = self.constant[name] - self.chance[name]
        if room <= 0:
            raise AssetError(
                f"the true draws are no closer to each other in {name} than to a constant layer: compare more draws or "
                "more vehicles."
            )
        return 1.0 - (distance - self.chance[name]) / room


@dataclass(frozen=True, eq=False)
class _Statistics:
    """What the parts compare; lists are of octaves.

    Attributes:
        mean, deviation: of every place of every vehicle.
        error: the expected square of the error of `mean`, from the number of draws.
    """

    patches: list[Float[Tensor, "projections quantiles"]]
    mean: Float[Tensor, "channels places"]
    error: Float[Tensor, "channels places"]
    deviation: Float[Tensor, "channels places"]
    share: Float[Tensor, " places"]
    spectrum: Float[Tensor, "octaves channels"]
    joint: list[Float[Tensor, "values values"]]
    amount: Float[Tensor, " quantiles"]


def _distances(made: _Statistics, truth: _Statistics) -> dict[str, float]:
    """d of each part. That of `mean` is a square, without what the numbers of draws add to it."""
    mean = ((made.mean - truth.mean).square() - made.error - truth.error).mean(dim=0)
    deviation = (made.deviation - truth.deviation).square().mean(dim=0)
    power = (made.spectrum - truth.spectrum).abs() / truth.spectrum.clamp(min=_VISIBLE)
    found = {
        "patches": _mean_of(zip(made.patches, truth.patches, strict=True), lambda a, b: (a - b).abs().mean()),
        "mean": (mean * truth.share).sum(),
        "deviation": (deviation * truth.share).sum(),
        "spectrum": power.mean(),
        "joint": _mean_of(zip(made.joint, truth.joint, strict=True), lambda a, b: (a - b).square().mean().sqrt()),
        "amount": (made.amount - truth.amount).abs().mean(),
    }
    return {name: float(value) for name, value in found.items()}


@dataclass(frozen=True, eq=False)
class _Measure:
    """What is measured of any stack of draws: the same places, patches and directions, in the truth's units.

    Attributes:
        patches: for each vehicle and octave, which patches are compared; the same number, or None.
        scale: the deviation of each value over all true draws.
        details, blocks: for each octave, what makes the true details, and the true blocks of the band, uncorrelated.
        directions: for each octave, what patches are projected on.
    """

    surfaces: Sequence[ScoredSurface]
    patches: list[list[Int[Tensor, " patches"] | None]]
    scale: Float[Tensor, " channels"]
    details: list[Float[Tensor, "channels channels"]]
    blocks: list[Float[Tensor, "values values"]]
    directions: list[Float[Tensor, "values projections"]]

    @classmethod
    def make(
        cls,
        surfaces: Sequence[ScoredSurface],
        truth: Sequence[Draws],
        seed: int,
        count: int = 192,
        projections: int = 128,
    ) -> _Measure:
        rng = torch.Generator().manual_seed(seed)  # of the CPU, so that all devices compare the same
        patches = [_choose_patches(surface, count, rng) for surface in surfaces]
        pyramids = [_octaves(draws, surface) for draws, surface in zip(truth, surfaces, strict=True)]
        channels, levels = pyramids[0][0].values.shape[1], len(pyramids[0])
        variance = sum(_variance(pyramid[0]) for pyramid in pyramids) / len(pyramids)
        size = (_PATCH * _PATCH * channels, projections)
        directions = [F.normalize(torch.randn(size, generator=rng), dim=0) for _ in range(levels)]
        return cls(
            surfaces,
            patches,
            (variance + _VISIBLE**2).sqrt(),
            [_whitening(_covariance([_details(p[n]) for p in pyramids])) for n in range(levels)],
            [_whitening(_covariance([p[n].blocks() for p in pyramids])) for n in range(levels)],
            [each.to(variance) for each in directions],
        )

    def statistics(self, stacks: Sequence[Draws]) -> _Statistics:
        pyramids = [_octaves(draws, surface) for draws, surface in zip(stacks, self.surfaces, strict=True)]
        levels, each = range(len(pyramids[0])), len(pyramids)
        places = [self._places(pyramid[0]) for pyramid in pyramids]
        mean, error, deviation, share = (torch.cat(values, dim=-1) for values in zip(*places, strict=True))
        spectrum = torch.stack([sum(p[n].power() for p in pyramids) / each for n in levels])
        blocks = [_covariance([p[n].blocks() for p in pyramids]) for n in levels]
        amounts = [_surface_mean(p[0].values[:, :1], p[0].weight) for p in pyramids]
        return _Statistics(
            patches=[values for n in levels if (values := self._patches(pyramids, n)) is not None],
            mean=mean,
            error=error,
            deviation=deviation,
            share=share / each,
            spectrum=spectrum.sqrt(),
            joint=[white @ found @ white for white, found in zip(self.blocks, blocks, strict=True)],
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


def _octaves(draws: Draws, surface: ScoredSurface) -> list[Octave]:
    return octaves(premultiplied(draws), surface.weight.to(draws.device))


def _choose_patches(
    surface: ScoredSurface, count: int, rng: torch.Generator
) -> list[Int[Tensor, " patches"] | None]:
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


def _variance(finest: Octave) -> Float[Tensor, " channels"]:
    """Over surface and draws."""
    mean, square = (_surface_mean(x, finest.weight).mean(dim=0) for x in (finest.values, finest.values.square()))
    return (square - mean.square()).clamp(min=0.0)


def _details(octave: Octave) -> tuple[Float[Tensor, "draws texels channels"], Float[Tensor, " texels"]]:
    inside = octave.weight > 0
    return octave.detail[:, :, inside].transpose(1, 2), octave.weight[inside]


def _covariance(samples: Sequence[tuple[Tensor, Tensor]]) -> Float[Tensor, "values values"]:
    """Mean products of values whose means are zero: of draws x samples x values with weights, over the vehicles."""
    products = [
        torch.einsum("nsx,nsy->xy", values * weight[:, None], values) / (len(values) * weight.sum())
        for values, weight in samples
        if len(weight)
    ]
    return torch.stack(products).mean(dim=0)


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


def _mean_layer(surfaces: Sequence[ScoredSurface], truth: Sequence[Draws]) -> Float[Tensor, " channels"]:
    """The constant layer of mean alpha, and of the maps' means weighted by alpha."""
    alpha, laid = torch.zeros(()).to(truth[0]), torch.zeros(truth[0].shape[-1]).to(truth[0])
    for surface, draws in zip(surfaces, truth, strict=True):
        share = (surface.weight / surface.weight.sum()).to(draws) * draws[..., 3] / len(draws)
        alpha, laid = alpha + share.sum(), laid + torch.einsum("nrcx,nrc->x", draws, share)
    layer = laid / alpha.clamp(min=1e-12)
    layer[3] = alpha / len(truth)
    return layer


def _mean_of(pairs: zip[tuple[Tensor, Tensor]], distance: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    return torch.stack([distance(made, truth) for made, truth in pairs]).mean()


def _require_fit(surfaces: Sequence[ScoredSurface], stacks: Sequence[Draws], what: str) -> None:
    if not surfaces or len(stacks) != len(surfaces):
        raise AssetError(f"there are {len(stacks)} stacks of {what} draws; wanted one for each of {len(surfaces)}.")
    for surface, draws in zip(surfaces, stacks, strict=True):
        if draws.ndim != 4 or draws.shape[1:3] != surface.weight.shape or len(draws) < 2:
            size = " x ".join(map(str, surface.weight.shape))
            raise AssetError(
                f"a stack of {what} draws has shape {tuple(draws.shape)}; wanted two or more of {size} texels."
            )
        if octave_count(*draws.shape[1:3]) < 2:
            raise AssetError(f"textures of {tuple(draws.shape[1:3])} texels cannot be halved twice: use 16 or more.")
