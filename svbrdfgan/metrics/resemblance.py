"""The score of a generator with random fields, `resemblance`: how alike its draws are to draws of the true layers.

Draws are compared as sets, by six parts that see different faults. Each part is a distance d, made a skill score by
`1 - (d(generator, truth) - d(truth', truth)) / (d(constant, truth) - d(truth', truth))`, where truth' is another set of
true draws. 1 is as close as other true draws are, 0 no closer than one constant layer. `resemblance` is the geometric
mean of the parts, each clipped to [0, 1]. `svbrdfgan.metrics.draw_statistics` defines the distances.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import torch
from jaxtyping import Float
from torch import Tensor

from svbrdfgan.config.models import StrictModel
from svbrdfgan.errors import AssetError
from svbrdfgan.metrics.draw_statistics import PARTS, Draws, Measure, ScoredSurface, Statistics, distances
from svbrdfgan.metrics.texture_pyramid import octave_count
from svbrdfgan.types import Layer, layer_channels

PART_MEANINGS: Mapping[str, str] = MappingProxyType(
    {
        "patches": "shapes, edges and grain, from single texels up to whole panels",
        "mean": "whether layers lie in the right places, averaged over draws",
        "deviation": "whether draws differ from each other as much as true ones do, place by place",
        "spectrum": "how strong the pattern is at each size: neither blurred nor noisy",
        "joint": "whether colour, coverage and the other maps belong together",
        "amount": "how much of the surface is covered in all",
    }
)
"""What each part compares with true draws, for readers who do not know its distance."""


class Resemblance(StrictModel):
    """The score of how alike draws of layers are to true ones, and its parts.

    Attributes:
        patches: patches of all maps, in every octave.
        mean: the mean over draws at each place, relative to that over the surface.
        deviation: the standard deviation over draws at each place.
        spectrum: power of alpha and of each map in each octave.
        joint: how each map depends on the others, in each octave; of the map that is worst.
        amount: mean alpha over the surface.
        draws: the generator's draws of each vehicle.

    All parts are skill scores: 1 is as close as other true draws, 0 is a constant layer. They are not clipped, so
    chance may bring them above 1.
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
        return self._mean(0.0)

    @property
    def rank(self) -> float:
        """The same of parts clipped to [0.05, 1], by which generators are chosen.

        A generator of which one part is no better than a constant layer has a resemblance of 0, however good the others
        are, and may still be better than one of which all are poor.
        """
        return self._mean(0.05)

    def _mean(self, least: float) -> float:
        return math.prod(min(max(value, least), 1.0) for value in self.parts.values()) ** (1 / len(PARTS))

    @property
    def least(self) -> str:
        """The name of the least part."""
        return min(self.parts, key=self.parts.__getitem__)

    def lines(self) -> list[str]:
        """The scores in words, one line each."""
        parts = ", ".join(f"{name} {value:.2f}" for name, value in self.parts.items())
        return [
            f"resemblance: {self.resemblance:.3f} (1: as alike as true draws are to each other, 0: one colour)",
            f"least part:  {self.least} {self.parts[self.least]:.2f} ({PART_MEANINGS[self.least]})",
            f"parts:       {parts}",
        ]


@dataclass(frozen=True, eq=False)
class Resembler:
    """Scores sets of draws against a set of true draws.

    Attributes:
        truth: the statistics of the true draws.
        chance: for each part, d(truth', truth).
        constant: for each part, d(constant, truth) of the constant layer that is closest in it.
        maps: those of the layers.
    """

    measure: Measure
    truth: Statistics
    chance: Mapping[str, float]
    constant: Mapping[str, float]
    maps: tuple[str, ...]

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
                twice; or true draws are no closer to each other than to a constant layer.
        """
        maps = truth[0].maps if truth else ()
        _require_fit(surfaces, truth, maps, "true")
        _require_fit(surfaces, again, maps, "other true")
        measure = Measure.make(surfaces, truth, seed)
        found = measure.statistics(truth)
        sets = max(1, len(again[0].values) // len(truth[0].values))
        chunks = [[Layer(draws.values.chunk(sets)[n], maps) for draws in again] for n in range(sets)]
        layers = [*constants.to(truth[0].values), _mean_layer(surfaces, truth)]
        flat = [[Layer(layer.expand(1, *surface.weight.shape, -1), maps) for surface in surfaces] for layer in layers]
        of_chance = [distances(measure.statistics(chunk), found) for chunk in chunks]
        of_constant = [distances(measure.statistics(stack), found) for stack in flat]
        chance = {name: sum(d[name] for d in of_chance) / sets for name in PARTS}
        constant = {name: min(d[name] for d in of_constant) for name in PARTS}
        for name in PARTS:
            if constant[name] <= chance[name]:
                raise AssetError(
                    f"the true draws are no closer to each other in {name} than to a constant layer: compare more "
                    "draws or more vehicles."
                )
        return cls(measure, found, chance, constant, maps)

    def score(self, generated: Sequence[Draws]) -> Resemblance:
        """The resemblance of a generator's draws, one stack for each vehicle.

        Raises:
            AssetError: the stacks do not fit the surfaces or are of one draw.
        """
        _require_fit(self.measure.surfaces, generated, self.maps, "generated")
        found = distances(self.measure.statistics(generated), self.truth)
        parts = {name: self._skill(name, found[name]) for name in PARTS}
        return Resemblance(**parts, subjects=len(generated), draws=len(generated[0].values))

    def _skill(self, name: str, distance: float) -> float:
        return 1.0 - (distance - self.chance[name]) / (self.constant[name] - self.chance[name])


def _mean_layer(surfaces: Sequence[ScoredSurface], truth: Sequence[Draws]) -> Float[Tensor, " channels"]:
    """The constant layer of mean alpha, and of the maps' means weighted by alpha."""
    first = truth[0].values
    alpha, laid = first.new_zeros(()), first.new_zeros(first.shape[-1])
    for surface, draws in zip(surfaces, truth, strict=True):
        share = (surface.weight / surface.weight.sum()).to(first) * draws.alpha / len(draws.values)
        alpha, laid = alpha + share.sum(), laid + torch.einsum("nrcx,nrc->x", draws.values, share)
    layer = replace(truth[0], values=laid / alpha.clamp(min=1e-12))
    layer["alpha"][:] = alpha / len(truth)
    return layer.values


def _require_fit(surfaces: Sequence[ScoredSurface], stacks: Sequence[Draws], maps: tuple[str, ...], what: str) -> None:
    if not surfaces or len(stacks) != len(surfaces):
        raise AssetError(f"there are {len(stacks)} stacks of {what} draws; wanted one for each of {len(surfaces)}.")
    for surface, draws in zip(surfaces, stacks, strict=True):
        if surface.weight.sum() <= 0:
            raise AssetError("nothing is scored on one of the vehicles: no texel has a weight.")
        shape, wanted = tuple(draws.values.shape), (*surface.weight.shape, layer_channels(maps))
        if len(shape) != 4 or shape[1:] != wanted or shape[0] < 2:
            size = "{} x {} texels, {} channels".format(*wanted)
            raise AssetError(f"a stack of {what} draws has shape {shape}; wanted two or more of {size}.")
        if octave_count(*shape[1:3]) < 2:
            raise AssetError(f"textures of {shape[1:3]} texels cannot be halved twice: use 16 or more.")
