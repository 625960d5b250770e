"""Figures of draws of layers that can be read without a scale: ratios to the truth, and correlations with it.

`resemblance` judges; these say in which direction draws are off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.metrics.draw_statistics import Draws, ScoredSurface
from svbrdfgan.metrics.texture_pyramid import octaves

_LEAST = 1e-12
_FLAT = 0.002  # slopes of about a tenth of a degree, which no picture shows


class AmountFigures(StrictModel):
    """The mean alpha over the learnable area next to the amount that is asked for; means over the vehicles.

    Attributes:
        correlation: rank correlation, over amounts, of the generator's mean alpha and the recipe's.
        error: mean absolute difference between the two at the same amount.
    """

    correlation: float
    error: float


class RelitFigures(StrictModel):
    """FLIP between pictures of two draws, in lights and from views that training never had; means over pairs of draws.

    Attributes:
        flip: between a true draw and one of the generator, of the same amount and recipe.
        of_truth: between the same true draws and other true ones.
        pairs: the number of pairs.
    """

    flip: float
    of_truth: float
    pairs: int

    @property
    def ratio(self) -> float:
        """1 where a draw is as far from a true one as another true one is, less for the mean of all draws."""
        return self.flip / self.of_truth


class DrawFigures(StrictModel):
    """Draws compared with true ones, in alpha and relief.

    Attributes:
        deviation: standard deviation over draws at each place, mean over the surface: over that of the truth.
        mean_correlation: correlation over the surface, of all vehicles, of the maps of mean alpha; without what the
            number of draws takes from it (Spearman 1904, "correction for attenuation"): by itself the mean of 16 draws
            of rust correlates by 0.5 with that of 16 others.
        power: power in each octave, finest first: over that of the truth.
        relief: likewise of the slopes, which are a normal's x and y times alpha; empty if the layers paint no normals.
            The power of slopes of a tenth of a degree is added to both, so that octaves that are flat in the truth and
            in the draws have a ratio of 1.
        amount: of a generator that knows amounts.
        relit: of a generator; None where no picture shows true draws to differ.
    """

    deviation: float
    mean_correlation: float
    power: tuple[float, ...]
    relief: tuple[float, ...] = ()
    amount: AmountFigures | None = None
    relit: RelitFigures | None = None

    def line(self) -> str:
        """The figures in words."""
        power, relief = (", ".join(f"{ratio:.2f}" for ratio in ratios) for ratios in (self.power, self.relief))
        amount, tilted = self.amount, f"; relief {relief} likewise" if relief else ""
        seen = "" if self.relit is None else f"; relit FLIP {self.relit.ratio:.2f} of that between true draws"
        obeyed = "" if amount is None else f"; amount: rank {amount.correlation:.2f}, error {amount.error:.3f}"
        return (
            f"deviation {self.deviation:.2f} of the truth's; mean maps correlate {self.mean_correlation:.2f}; power "
            f"{power} of the truth's, finest octave first{tilted}{seen}{obeyed}"
        )


def draw_figures(surfaces: Sequence[ScoredSurface], truth: Sequence[Draws], made: Sequence[Draws]) -> DrawFigures:
    """The figures of draws compared with true ones, without `amount` and `relit`; a stack of each for each vehicle."""
    sides = [[draws.alpha for draws in stacks] for stacks in (truth, made)]
    deviation = [_deviation(side, surfaces) for side in sides]
    power = [_power([alpha.unsqueeze(1) for alpha in side], surfaces) for side in sides]
    return DrawFigures(
        deviation=float(_ratio(*deviation)),
        mean_correlation=_correlation_of_means(sides[0], sides[1], surfaces),
        power=tuple(_ratio(*power).tolist()),
        relief=_relief(surfaces, truth, made),
    )


def amount_figures(
    truth: Sequence[Float[Tensor, " amounts"]], made: Sequence[Float[Tensor, " amounts"]]
) -> AmountFigures:
    """Mean alpha of the recipe and of the generator at the same amounts, each for several vehicles or recipes."""
    pairs = list(zip(truth, made, strict=True))
    ranked = [_correlation(_ranks(a), _ranks(b)) for a, b in pairs]
    errors = [(a - b).abs().mean() for a, b in pairs]
    return AmountFigures(correlation=float(torch.stack(ranked).mean()), error=float(torch.stack(errors).mean()))


def relit_figures(truth: Sequence[float], made: Sequence[float]) -> RelitFigures | None:
    """The means of FLIP from true draws to other true ones, and to a generator's; None where true ones never differ."""
    if not sum(truth):
        return None
    return RelitFigures(flip=sum(made) / len(made), of_truth=sum(truth) / len(truth), pairs=len(truth))


def _correlation_of_means(truth: Sequence[Tensor], made: Sequence[Tensor], surfaces: Sequence[ScoredSurface]) -> float:
    products = torch.stack([_moments(*each) for each in zip(truth, made, surfaces, strict=True)]).mean(dim=0)
    together, of_truth, of_made = products.tolist()
    if min(of_truth, of_made) <= 0:  # a map no less even than chance makes it
        return 0.0
    return min(max(together / math.sqrt(of_truth * of_made), -1.0), 1.0)


def _moments(truth: Tensor, made: Tensor, surface: ScoredSurface) -> Float[Tensor, " moments"]:
    """Covariance of the mean maps over the surface, and the variance of each less that of its error.

    Maps are relative to each draw's own mean over the surface, since draws differ in their amounts.
    """
    weight = surface.weight / surface.weight.sum()
    relative = [side - (side * weight).sum(dim=(1, 2), keepdim=True) for side in (truth, made)]
    a, b = (each.mean(dim=0) for each in relative)
    errors = [_mean(each.var(dim=0), weight) / len(each) for each in relative]
    return torch.stack(
        [_mean(a * b, weight), _mean(a.square(), weight) - errors[0], _mean(b.square(), weight) - errors[1]]
    )


def _deviation(side: Sequence[Tensor], surfaces: Sequence[ScoredSurface]) -> Float[Tensor, ""]:
    means = [_mean(alpha.std(dim=0), surface.weight) for alpha, surface in zip(side, surfaces, strict=True)]
    return torch.stack(means).mean()


def _relief(surfaces: Sequence[ScoredSurface], truth: Sequence[Draws], made: Sequence[Draws]) -> tuple[float, ...]:
    if "normal" not in truth[0].maps:
        return ()
    slopes = [
        [draws["normal"][..., :2].movedim(-1, 1) * draws.alpha.unsqueeze(1) for draws in stacks]
        for stacks in (truth, made)
    ]
    power = [_power(side, surfaces) + _FLAT**2 for side in slopes]
    return tuple(_ratio(*power).tolist())


def _power(side: Sequence[Tensor], surfaces: Sequence[ScoredSurface]) -> Float[Tensor, " octaves"]:
    """The power in each octave, of all values together."""
    found = [
        torch.stack([octave.power().sum() for octave in octaves(values, surface.weight)])
        for values, surface in zip(side, surfaces, strict=True)
    ]
    return torch.stack(found).mean(dim=0)


def _ratio(truth: Tensor, made: Tensor) -> Tensor:
    return made / truth.clamp(min=_LEAST)


def _correlation(a: Float[Tensor, " values"], b: Float[Tensor, " values"]) -> Float[Tensor, ""]:
    """Pearson's; 0 if either side is constant."""
    a, b = a - a.mean(), b - b.mean()
    return ((a * b).sum() / (a.norm() * b.norm()).clamp(min=_LEAST)).clamp(-1.0, 1.0)  # which rounding may leave


def _mean(values: Tensor, weight: Tensor) -> Float[Tensor, ""]:
    return (values * weight).sum() / weight.sum()


def _ranks(values: Float[Tensor, " values"]) -> Float[Tensor, " values"]:
    """Equal values share the mean of their ranks."""
    less, equal = values[:, None] > values, values[:, None] == values
    return less.sum(dim=1) + 0.5 * equal.sum(dim=1)
