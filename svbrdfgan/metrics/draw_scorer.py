"""Resemblance of generators on the vehicles of a split, whose true draws are painted once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.true_draws import Sweeps, Vehicle, paint_all, weathering_of
from svbrdfgan.metrics.draw_statistics import Draws, ScoredSurface
from svbrdfgan.metrics.recovered import Scorer
from svbrdfgan.metrics.resemblance import Resemblance, Resembler
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.draw import Draw
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.types import Layer


@dataclass(frozen=True, eq=False)
class DrawScorer:
    """Scores generators by the resemblance of their draws to the same true ones.

    Attributes:
        inputs: those of generators for each vehicle, as batches of one.
        vehicles: those that are compared, with the scenes of their draws.
    """

    inputs: Sequence[Inputs]
    vehicles: Sequence[Vehicle]
    resembler: Resembler
    conditions: Conditions

    @classmethod
    def make(
        cls,
        exemplars: Exemplars,
        scorer: Scorer,
        constants: Tensor,
        declared: WeatheringDistribution,
        conditions: Conditions,
        *,
        count: int,
        limit: int,
    ) -> DrawScorer:
        """Paints twice `count` true draws of each of at most `limit` vehicles, evenly chosen, in this process.

        Args:
            scorer: of the split; says which texels are scored, and on which device.
            constants: constant layers to compare with.
            declared: says which seeds true layers have.

        Raises:
            AssetError: the true draws do not vary, or the textures are too small to compare.
        """
        weights = {target.subject: target.weight for target in scorer.targets}
        numbers = list(weights)
        if len(numbers) > limit:
            numbers = [numbers[int(i)] for i in torch.linspace(0, len(numbers) - 1, limit)]
        vehicles = [vehicle_of(exemplars, number, declared, count) for number in numbers]
        surfaces, truth, again = [], list[Draws](), list[Draws]()
        for vehicle, drawn in zip(vehicles, paint_all(vehicles, workers=1), strict=True):
            weight = weights[vehicle.number]
            surfaces.append(scored_surface(exemplars, vehicle, weight))
            first, second = drawn.halves(exemplars.scenes[0].maps, weight.device)
            truth.append(first)
            again.append(second)
        resembler = Resembler.make(surfaces, truth, again, constants)
        return cls([scorer.inputs.pick(slice(n, n + 1)) for n in numbers], vehicles, resembler, conditions)

    def score(self, generator: Generator, fabric: Fabric) -> Resemblance:
        """The resemblance of the generator's draws with seeds from 0 on."""
        asked = zip(self.inputs, self.vehicles, strict=True)
        return self.resembler.score([draws_of(generator, self.conditions, fabric, *each) for each in asked])


def vehicle_of(
    exemplars: Exemplars, number: int, declared: WeatheringDistribution, count: int, sweeps: Sweeps = ()
) -> Vehicle:
    """The subject of this number, with the amounts and recipes of its own exemplars in turn, for so many draws."""
    scenes = [exemplars.scenes[view] for view in exemplars.views_of(number) if exemplars.weathered(view)]
    drawn = tuple(scenes[n % len(scenes)] for n in range(count))
    return Vehicle(exemplars.loader.folder, number, drawn, declared, sweeps)


def scored_surface(exemplars: Exemplars, vehicle: Vehicle, weight: Float[Tensor, "rows cols"]) -> ScoredSurface:
    return ScoredSurface(weight, exemplars.subjects[vehicle.number].buffer.part.to(weight.device))


def draws_of(
    generator: Generator,
    conditions: Conditions,
    fabric: Fabric,
    inputs: Inputs,
    vehicle: Vehicle,
) -> Draws:
    """Draws of the generator with the amounts and recipes of the vehicle's scenes, and seeds from 0 on.

    Args:
        inputs: the vehicle's, a batch of one.
    """
    layers = []
    for seed, scene in enumerate(vehicle.scenes):
        wanted = weathering_of(scene)
        labels = conditions.labels(wanted.amount, wanted.recipe)
        with torch.no_grad(), fabric.autocast():
            layers.append(Draw(generator, seed, labels).on(inputs)[0].float())
    return Layer(torch.stack(layers), generator.maps)
