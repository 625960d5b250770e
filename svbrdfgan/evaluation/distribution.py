"""The resemblance of generators to the distribution of the true layers: draws of both, on the scored vehicles."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.true_draws import Sweeps, Vehicle, paint_all
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.evaluation.relit_draws import DrawRelighter
from svbrdfgan.metrics.draw_figures import DrawFigures, amount_figures, draw_figures, relit_figures
from svbrdfgan.metrics.draw_scorer import draws_of, scored_surface, vehicle_of
from svbrdfgan.metrics.draw_statistics import Draws, ScoredSurface
from svbrdfgan.metrics.recovered import Scorer
from svbrdfgan.metrics.resemblance import Resemblance, Resembler
from svbrdfgan.networks.generator import Generator
from svbrdfgan.networks.inputs import Inputs
from svbrdfgan.training.batches import Progress
from svbrdfgan.training.run import RunConfig
from svbrdfgan.types import Layer

DRAWS = 16
"""Layers of each vehicle, in each of three sets: true ones, other true ones, and a generator's."""
_AMOUNTS = 8  # in a sweep from the least to the greatest
_BATCH = 4  # draws at once, where nothing but their mean alpha is kept: as many as train at 1,024 texels


@dataclass(frozen=True, eq=False)
class Comparison:
    """Draws of several painters, compared with the same true ones.

    Attributes:
        resemblance: of each painter that is a generator.
        figures: likewise, and of the truth, for which other true draws stand: what can be reached with so few draws.
        refusal: why the draws of a distribution have no scores; else empty.
    """

    resemblance: Mapping[Painter, Resemblance] = field(default_factory=dict)
    figures: Mapping[Painter, DrawFigures] = field(default_factory=dict)
    refusal: str = ""


@dataclass(frozen=True, eq=False)
class _Asked:
    """The input of generators for draws of a vehicle.

    Attributes:
        inputs: a batch of one.
        area: the share of each texel in the learnable area.
    """

    inputs: Inputs
    area: Float[Tensor, "rows cols"]
    vehicle: Vehicle


def compare_draws(
    generators: Mapping[Painter, Generator],
    config: RunConfig,
    fabric: Fabric,
    exemplars: Exemplars,
    scorer: Scorer,
    constants: Tensor,
    progress: Progress | None = None,
    count: int = DRAWS,
    workers: int = 1,
    relighter: DrawRelighter | None = None,
) -> Comparison:
    """The scores of generators' draws on the split's vehicles.

    All sets have the amounts and recipes of the vehicle's own exemplars, in turn, so that sets differ by their seeds
    alone. Painting the true ones takes most of the time: some tenths of a second for each layer of 256 x 256.

    Args:
        generators: on the scorer's device; all have the conditions of the run.
        config: the run's.
        scorer: of the split; says which texels are scored.
        constants: constant layers to compare with.
        progress: called with the number of vehicles that are done since the last call.
        count: draws of each vehicle in each set.
        workers: processes that paint true layers; see `paint_all`.
        relighter: compares pictures of draws; without one, no figures are `relit`.

    Raises:
        AssetError: the true draws do not vary, or the textures are too small to compare.
    """
    declared = config.dataset.weathering
    assert declared is not None, "a split is scored only if its layers are known"
    weights = {target.subject: target.weight for target in scorer.targets}
    surfaces: list[ScoredSurface] = []
    truth: list[Draws] = []
    sets: dict[Painter, list[Draws]] = {"truth": [], **{name: [] for name in generators}}
    painted: dict[Painter, list[Tensor]] = {name: [] for name in sets}
    flips = defaultdict[Painter, list[float]](list)
    vehicles = [
        vehicle_of(exemplars, number, declared, count, sweeps)
        for number, sweeps in _sweeps(config, exemplars, list(weights)).items()
    ]
    for vehicle, drawn in zip(vehicles, paint_all(vehicles, workers), strict=True):
        number = vehicle.number
        weight = weights[number]
        surfaces.append(scored_surface(exemplars, vehicle, weight))
        first, again = drawn.halves(config.dataset.maps, weight.device)
        truth.append(first)
        sets["truth"].append(again)
        painted["truth"] += [torch.from_numpy(row) for row in drawn.amounts]
        asked = _Asked(
            scorer.inputs.pick(slice(number, number + 1)), torch.from_numpy(drawn.area).to(weight.device), vehicle
        )
        for name, generator in generators.items():
            sets[name].append(draws_of(generator, config.conditions, fabric, asked.inputs, vehicle))
            painted[name] += _generated_amounts(generator, config, fabric, asked)
        if relighter is not None:
            drawn_last = {name: stacks[-1] for name, stacks in sets.items()}
            for name, found in relighter.flips(vehicle.number, first, drawn_last).items():
                flips[name] += found
        if progress is not None:
            progress(1)
    resembler = Resembler.make(surfaces, truth, sets["truth"], constants)
    figures = {name: draw_figures(surfaces, truth, draws) for name, draws in sets.items()}
    for name in generators if painted["truth"] else ():
        obeyed = amount_figures(painted["truth"], painted[name])
        figures[name] = figures[name].model_copy(update={"amount": obeyed})
    for name in generators:
        relit = relit_figures(flips["truth"], flips[name])
        figures[name] = figures[name].model_copy(update={"relit": relit})
    return Comparison({name: resembler.score(sets[name]) for name in generators}, figures)


def _generated_amounts(
    generator: Generator, config: RunConfig, fabric: Fabric, asked: _Asked
) -> list[Float[Tensor, " amounts"]]:
    """The generator's mean alpha over the learnable area, a row for each sweep; means of as many draws."""
    count, device = len(asked.vehicle.scenes), asked.area.device

    def mean_alpha(amount: float, recipe: str) -> float:
        labels = torch.tensor([config.conditions.labels(amount, recipe)], device=device)
        total = torch.zeros((), device=device)
        for seeds in torch.arange(count, device=device).split(_BATCH):
            inputs = asked.inputs.pick(torch.zeros_like(seeds))
            with torch.no_grad(), fabric.autocast():
                layers = generator.paint(inputs, seeds, labels.expand(len(seeds), -1))
            total += (Layer(layers, generator.maps).alpha.float() * asked.area).sum()
        return float(total) / count

    sweeps = asked.vehicle.sweeps
    return [torch.tensor([mean_alpha(amount, recipe) for amount in amounts]) for recipe, amounts in sweeps]


def _sweeps(config: RunConfig, exemplars: Exemplars, numbers: Sequence[int]) -> dict[int, Sweeps]:
    """Each recipe, with amounts from the least to the greatest that the run knows; none if it knows no amounts.

    Of the windows of a mesh, the first alone has any: a generator that refines layers paints the whole map each time.
    """
    known, swept = config.conditions, set[str]()
    every: Sweeps = ()
    if known.amount is not None:
        amounts = tuple(torch.linspace(*known.amount, _AMOUNTS).tolist())
        every = tuple((recipe, amounts) for recipe in known.recipes)
    found: dict[int, Sweeps] = {}
    for number in numbers:
        mesh = exemplars.scenes[exemplars.views_of(number)[0]].mesh.path
        found[number] = () if mesh in swept else every
        swept.add(mesh)
    return found
