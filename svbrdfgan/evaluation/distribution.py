"""How generators resemble the distribution of the true layers: draws of both, on the scored vehicles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float
from lightning_fabric import Fabric
from torch import Tensor

from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.metrics.draw_figures import DrawFigures, amount_figures, draw_figures
from svbrdfgan.metrics.draw_statistics import Draws, ScoredSurface
from svbrdfgan.metrics.recovered import Scorer
from svbrdfgan.metrics.resemblance import Resemblance, Resembler
from svbrdfgan.networks import Draw, Generator
from svbrdfgan.rendering.compositing import RGBA
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader, recipe_of
from svbrdfgan.scene.subject import Subject
from svbrdfgan.training.batches import Progress
from svbrdfgan.training.run import RunConfig
from svbrdfgan.weathering.site import Site

DRAWS = 16
"""Layers of each vehicle, in each of three sets: true ones, other true ones, and a generator's."""
TRUTH = "truth"
"""The name of the other true draws, beside the names of generators."""
_AMOUNTS = 8
_BATCH = 4  # draws at once, where nothing but their mean alpha is kept: as many as train at 1,024 texels
_POINTS = 4096  # texels for the recipe's mean alpha, which is known to a fraction of a percent by so many


@dataclass(frozen=True, eq=False)
class Comparison:
    """Draws of several generators beside the same true ones.

    Attributes:
        resemblance: by the generator's name.
        figures: likewise, and of `TRUTH`, other true draws: what can be reached with so few draws.
    """

    resemblance: dict[str, Resemblance]
    figures: dict[str, DrawFigures]


@dataclass(frozen=True, eq=False)
class _Vehicle:
    """A scored vehicle.

    Attributes:
        number: index of the subject in its split.
        scenes: one for each draw: it has the amount and recipe of one of the vehicle's own exemplars.
        geometry: the generators' input.
    """

    loader: SceneLoader
    number: int
    subject: Subject
    scenes: list[Scene]
    geometry: Float[Tensor, "6 rows cols"]

    @property
    def site(self) -> Site:
        return self.loader.site(self.scenes[0])

    @cached_property
    def area(self) -> Float[Tensor, "rows cols"]:
        """The share of each texel in the learnable area."""
        area = self.subject.buffer.area * self.subject.learnable_texels
        return area / area.sum()


def compare_draws(
    generators: Mapping[str, Generator],
    config: RunConfig,
    fabric: Fabric,
    exemplars: Exemplars,
    scorer: Scorer,
    constants: Tensor,
    progress: Progress | None = None,
    count: int = DRAWS,
) -> Comparison:
    """The scores of generators' draws on the split's vehicles.

    All sets have the amounts and recipes of the vehicle's own exemplars, in turn, so that sets differ by their seeds
    alone. Painting the true ones takes most of the time: some tenths of a second for each layer of 256 x 256.

    Args:
        generators: by name, on the scorer's device; all are told the conditions of the run.
        config: the run's.
        scorer: of the split; says which texels are scored.
        constants: constant layers to compare with.
        progress: called with the number of vehicles that are done since the last call.
        count: draws of each vehicle in each set.

    Raises:
        AssetError: the true draws do not vary, or the textures are too small to compare.
    """
    declared = config.dataset.weathering
    assert declared is not None, "a split is scored only if its layers are known"
    weights = {target.subject: target.weight for target in scorer.targets}
    surfaces: list[ScoredSurface] = []
    truth: list[Draws] = []
    sets: dict[str, list[Draws]] = {name: [] for name in (TRUTH, *generators)}
    painted: dict[str, list[Tensor]] = {name: [] for name in sets}
    for number, weight in weights.items():
        vehicle = _vehicle(exemplars, number, scorer.geometry[number], count)
        surfaces.append(ScoredSurface(weight, vehicle.subject.buffer.part.to(weight.device)))
        first, again = _true_draws(vehicle, declared).to(weight.device).chunk(2)
        truth.append(first)
        sets[TRUTH].append(again)
        painted[TRUTH] += _true_amounts(vehicle, config, declared, count)
        for name, generator in generators.items():
            sets[name].append(_generated(generator, config, fabric, vehicle))
            painted[name] += _generated_amounts(generator, config, fabric, vehicle, count)
        if progress is not None:
            progress(1)
    resembler = Resembler.make(surfaces, truth, sets[TRUTH], constants)
    figures = {name: draw_figures(surfaces, truth, draws) for name, draws in sets.items()}
    for name in generators if painted[TRUTH] else ():
        obeyed = amount_figures(painted[TRUTH], painted[name])
        figures[name] = figures[name].model_copy(update={"amount": obeyed})
    return Comparison({name: resembler.score(sets[name]) for name in generators}, figures)


def _vehicle(exemplars: Exemplars, number: int, geometry: Tensor, count: int) -> _Vehicle:
    scenes = [exemplars.scenes[view] for view in exemplars.views_of(number) if exemplars.weathered(view)]
    return _Vehicle(
        exemplars.loader, number, exemplars.subjects[number], [scenes[n % len(scenes)] for n in range(count)], geometry
    )


def _true_draws(vehicle: _Vehicle, declared: WeatheringDistribution) -> Draws:
    """Two sets of true layers of the vehicle's scenes, each painted with a new seed."""
    rng, layers = np.random.default_rng([1, vehicle.number]), []
    for scene in vehicle.scenes * 2:
        drawn = _weathering(scene).model_copy(update={"seed": declared.seed.sample(rng)})
        layers.append(vehicle.loader.paint(scene, drawn))
    return torch.stack(layers)


def _generated(generator: Generator, config: RunConfig, fabric: Fabric, vehicle: _Vehicle) -> Draws:
    """What the generator paints with the amounts and recipes of the vehicle's scenes, and seeds from 0 on."""
    layers = []
    for seed, scene in enumerate(vehicle.scenes):
        asked = _weathering(scene)
        labels = config.conditions.labels(asked.amount, asked.recipe)
        with torch.no_grad(), fabric.autocast():
            layers.append(Draw(generator, seed, labels)(vehicle.geometry.unsqueeze(0))[0].float())
    return torch.stack(layers)


def _true_amounts(
    vehicle: _Vehicle, config: RunConfig, declared: WeatheringDistribution, count: int
) -> list[Float[Tensor, " amounts"]]:
    """Mean alpha over the learnable area at growing amounts, one row for each recipe; means of true draws."""
    rng = np.random.default_rng([2, vehicle.number])
    share = vehicle.area.flatten().double().numpy()
    site = vehicle.site.at(rng.choice(share.size, _POINTS, p=share / share.sum()))
    seeds, scene = [declared.seed.sample(rng) for _ in range(count)], vehicle.scenes[0]

    def covered(drawn: SceneWeathering) -> float:
        if drawn.model is None:
            return float(recipe_of(drawn).paint(site).alpha.mean())
        return float((vehicle.loader.paint(scene, drawn)[..., RGBA - 1] * vehicle.area).sum())

    def mean_alpha(amount: float, recipe: str) -> float:
        asked = {"amount": amount, "recipe": recipe}
        drawn = [_weathering(scene).model_copy(update=asked | {"seed": seed}) for seed in seeds]
        return float(np.mean([covered(each) for each in drawn]))

    return [torch.tensor([mean_alpha(amount, recipe) for amount in amounts]) for recipe, amounts in _sweeps(config)]


def _generated_amounts(
    generator: Generator, config: RunConfig, fabric: Fabric, vehicle: _Vehicle, count: int
) -> list[Float[Tensor, " amounts"]]:
    """Likewise of the generator."""
    area = vehicle.area.to(vehicle.geometry.device)

    def mean_alpha(amount: float, recipe: str) -> float:
        labels = torch.tensor([config.conditions.labels(amount, recipe)], device=area.device)
        total = torch.zeros((), device=area.device)
        for seeds in torch.arange(count, device=area.device).split(_BATCH):
            geometry = vehicle.geometry.expand(len(seeds), -1, -1, -1)
            with torch.no_grad(), fabric.autocast():
                layers = generator(geometry, seeds, labels.expand(len(seeds), -1))
            total += (layers[..., RGBA - 1].float() * area).sum()
        return float(total) / count

    return [torch.tensor([mean_alpha(amount, recipe) for amount in amounts]) for recipe, amounts in _sweeps(config)]


def _sweeps(config: RunConfig) -> list[tuple[str, list[float]]]:
    """Each recipe, with amounts from the least to the greatest that the run knows; none if it knows no amounts."""
    known = config.conditions
    if known.amount is None:
        return []
    return [(recipe, torch.linspace(*known.amount, _AMOUNTS).tolist()) for recipe in known.recipes]


def _weathering(scene: Scene) -> SceneWeathering:
    assert isinstance(scene.weathering, SceneWeathering)
    return scene.weathering
