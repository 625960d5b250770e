"""The report's sheets of draws: what seed, amount and recipe make of a vehicle's layer."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.networks.draw import Draw
from svbrdfgan.report.pictures import Picture, over_checker, upright
from svbrdfgan.report.vehicles import Titled, Vehicle, subject_name
from svbrdfgan.scene.description import SceneWeathering
from svbrdfgan.types import Layer

COLUMNS = 6


def sheets(evaluated: Evaluated, indices: Sequence[int]) -> list[Vehicle]:
    """A sheet for the subject of each of these weathered exemplars; none if the generator paints one layer on each.

    A sheet has the exemplar's true layer, draws of seeds, amounts from the least to the greatest that the model knows,
    and a picture for each recipe.
    """
    if evaluated.generator is None or not evaluated.generator.varies:
        return []
    return [_sheet(evaluated, index) for index in indices]


def _sheet(evaluated: Evaluated, index: int) -> Vehicle:
    exemplars, known = evaluated.source.exemplars, evaluated.config.conditions
    scene, truth = exemplars.scenes[index], exemplars.layers[index]
    assert isinstance(scene.weathering, SceneWeathering)
    assert truth is not None
    amount, recipe = scene.weathering.amount, scene.weathering.recipe
    shown = [Titled("Truth", _upright(evaluated, index, truth), f"{recipe}, amount {amount:.2f}")]

    def add(title: str, seed: int = 0, amount: float = amount, recipe: str = recipe) -> None:
        shown.append(Titled(title, _drawn(evaluated, index, seed, known.labels(amount, recipe))))

    if evaluated.generator is not None and evaluated.generator.random_fields:
        for seed in range(COLUMNS - 1):
            add(f"Seed {seed}", seed)
    if known.amount is not None:
        for step in torch.linspace(*known.amount, COLUMNS).tolist():
            add(f"Amount {step:.2f}", amount=step)
    for other in known.recipes if len(known.recipes) > 1 else ():
        add(other, recipe=other)
    return Vehicle(
        subject_name(scene), "seed 0 and the exemplar's amount and recipe, where nothing else is said", tuple(shown)
    )


def _drawn(evaluated: Evaluated, index: int, seed: int, labels: Sequence[float]) -> Picture:
    assert evaluated.generator is not None
    with torch.no_grad():
        painted = Draw(evaluated.generator, seed, labels)(evaluated.source.geometry([index]))[0]
    return _upright(evaluated, index, Layer(painted.cpu().float(), evaluated.generator.maps))


def _upright(evaluated: Evaluated, index: int, layer: Layer) -> Picture:
    return upright(over_checker(layer), evaluated.source.exemplars.subject(index).learnable_texels)
