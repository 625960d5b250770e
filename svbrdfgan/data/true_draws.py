"""True draws of vehicles, painted by their recipe or model; for several vehicles at once in worker processes."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from svbrdfgan.data.config import WeatheringDistribution
from svbrdfgan.scene.description import Scene, SceneWeathering
from svbrdfgan.scene.loader import SceneLoader, recipe_of
from svbrdfgan.types import Layer
from svbrdfgan.utils.processes import worker_pool

Sweeps = tuple[tuple[str, tuple[float, ...]], ...]
"""Recipes, each with amounts for which mean alpha is wanted."""

_POINTS = 4096  # texels for the recipe's mean alpha, enough to know it to a fraction of a percent


@dataclass(frozen=True)
class Vehicle:
    """One vehicle and what is to be painted on it.

    Attributes:
        folder: of its data set.
        number: index of the subject in its split; true seeds depend on it.
        scenes: one for each draw: it has the amount and recipe of one of the vehicle's own exemplars.
        declared: says which seeds true layers have.
        sweeps: the mean alphas that are wanted.
    """

    folder: Path
    number: int
    scenes: tuple[Scene, ...]
    declared: WeatheringDistribution
    sweeps: Sweeps = ()


@dataclass(frozen=True, eq=False)
class TrueDraws:
    """The true draws of a vehicle. NumPy's arrays, since torch would pass its own between processes in shared memory.

    Attributes:
        layers: one for each scene with a new seed, and the same scenes again with other seeds (`halves`).
        area: the share of each texel in the learnable area.
        amounts: mean alpha over that area, a row for each of the vehicle's sweeps; means of as many draws as scenes.
    """

    layers: Float[ndarray, "draws rows cols channels"]
    area: Float[ndarray, "rows cols"]
    amounts: list[Float[ndarray, " amounts"]]

    def halves(self, maps: Collection[str], device: torch.device) -> tuple[Layer, Layer]:
        """Two sets of draws of the same scenes, stacks of layers."""
        first, again = torch.from_numpy(self.layers).to(device).chunk(2)
        return Layer(first, tuple(maps)), Layer(again, tuple(maps))


def paint_all(vehicles: Sequence[Vehicle], workers: int) -> Iterator[TrueDraws]:
    """Yields the true draws of each vehicle, in order; from this process if it has a GPU, or if a model paints.

    Args:
        workers: processes. The pool spawns them, so they import the caller's main module.

    Raises:
        AssetError: a mesh's file is missing or has changed; or a process was killed.
    """
    here = torch.cuda.is_available() or any(weathering_of(vehicle.scenes[0]).model for vehicle in vehicles)
    if workers == 1 or len(vehicles) < 2 or here:
        shared = {vehicle.folder: SceneLoader(vehicle.folder) for vehicle in vehicles}
        yield from (paint(vehicle, shared[vehicle.folder]) for vehicle in vehicles)
        return
    with worker_pool(min(workers, len(vehicles)), "paints layers", "--workers") as pool:
        yield from pool.map(paint, vehicles)


def paint(vehicle: Vehicle, loader: SceneLoader | None = None) -> TrueDraws:
    """The true draws of one vehicle, which depend on nothing else."""
    found = loader or SceneLoader(vehicle.folder)
    subject = found.subject(vehicle.scenes[0])
    area = (subject.buffer.area * subject.learnable_texels).numpy()
    share = area / area.sum()
    return TrueDraws(_layers(vehicle, found), share, _amounts(vehicle, found, share))


def _layers(vehicle: Vehicle, loader: SceneLoader) -> Float[ndarray, "draws rows cols channels"]:
    rng, layers = np.random.default_rng([1, vehicle.number]), []
    for scene in vehicle.scenes * 2:
        drawn = weathering_of(scene).model_copy(update={"seed": vehicle.declared.seed.sample(rng)})
        layers.append(loader.paint(scene, drawn).values.numpy())
    return np.stack(layers)


def _amounts(
    vehicle: Vehicle, loader: SceneLoader, area: Float[ndarray, "rows cols"]
) -> list[Float[ndarray, " amounts"]]:
    rng, scene = np.random.default_rng([2, vehicle.number]), vehicle.scenes[0]
    share = area.ravel().astype(np.float64)
    site = loader.site(scene).at(torch.from_numpy(rng.choice(share.size, _POINTS, p=share / share.sum())))
    seeds = [vehicle.declared.seed.sample(rng) for _ in vehicle.scenes]

    def covered(drawn: SceneWeathering) -> float:
        if drawn.model is None:
            return float(recipe_of(drawn).paint(site).alpha.mean())
        return float((loader.paint(scene, drawn).alpha.numpy() * area).sum())

    def mean_alpha(amount: float, recipe: str) -> float:
        asked = {"amount": amount, "recipe": recipe}
        drawn = [weathering_of(scene).model_copy(update=asked | {"seed": seed}) for seed in seeds]
        return float(np.mean([covered(each) for each in drawn]))

    return [np.array([mean_alpha(amount, recipe) for amount in amounts]) for recipe, amounts in vehicle.sweeps]


def weathering_of(scene: Scene) -> SceneWeathering:
    """The scene's weathering, which must be known."""
    assert isinstance(scene.weathering, SceneWeathering)
    return scene.weathering
