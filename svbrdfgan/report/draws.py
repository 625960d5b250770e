"""The report's draws: renders beside those of true draws, and what seed, amount and recipe make of a layer."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from svbrdfgan.evaluation.evaluated import Evaluated, pictures
from svbrdfgan.networks.draw import Draw
from svbrdfgan.report.pictures import Picture, framed, over_checker, upright
from svbrdfgan.report.vehicles import Titled, Vehicle, scene_note, subject_name, weathering_note
from svbrdfgan.scene.description import SceneWeathering
from svbrdfgan.types import Layer

COLUMNS = 6
STRIP = 4
"""Draws in a row of a strip."""


def strip(evaluated: Evaluated, index: int) -> Vehicle:
    """Renders of a weathered exemplar's scene: a row of true draws, and below each a draw of the generator.

    The draws of a column have the amount and recipe of the same exemplar of the subject, in the order of amounts; seeds
    are independent. True draws are the exemplars' own layers and, where these are fewer than the columns, new ones.
    """
    exemplars = evaluated.source.exemplars
    views = _chosen(evaluated, index)
    truth = [_true_layer(evaluated, views, column) for column in range(STRIP)]
    made = [_draw(evaluated, index, n, _own_labels(evaluated, view)) for n, view in enumerate(views)]
    shown = [framed(each, exemplars.coverage[index]) for each in pictures(evaluated.source, index, truth + made)]
    titles = ["True draw"] * STRIP + ["Learned draw"] * STRIP
    notes = [weathering_note(exemplars.scenes[view]) for view in views] * 2
    scene = exemplars.scenes[index]
    return Vehicle(subject_name(scene), scene_note(scene), tuple(map(Titled, titles, shown, notes)))


def amount_of(evaluated: Evaluated, index: int) -> float:
    """The amount of a weathered exemplar."""
    return _weathering(evaluated, index).amount


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
    scene, truth, weathering = exemplars.scenes[index], exemplars.layers[index], _weathering(evaluated, index)
    assert truth is not None
    amount, recipe = weathering.amount, weathering.recipe
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


def _chosen(evaluated: Evaluated, index: int) -> list[int]:
    """As many exemplars of the subject as a strip has columns, evenly spread over amounts; some repeatedly if few."""
    exemplars = evaluated.source.exemplars
    own = exemplars.views_of(int(exemplars.subject_of[index]))
    views = sorted(filter(exemplars.weathered, own), key=lambda view: amount_of(evaluated, view))
    return [views[round(n)] for n in np.linspace(0, len(views) - 1, STRIP)]


def _true_layer(evaluated: Evaluated, views: Sequence[int], column: int) -> Layer:
    """The layer of the column's exemplar; of one that an earlier column shows, with a new seed."""
    exemplars, config, view = evaluated.source.exemplars, evaluated.config.dataset.weathering, views[column]
    own = exemplars.layers[view]
    assert own is not None
    if view not in views[:column]:
        return own
    assert config is not None
    seed = config.seed.sample(np.random.default_rng([3, view, column]))
    weathering = _weathering(evaluated, view).model_copy(update={"seed": seed})
    return exemplars.loader.paint(exemplars.scenes[view], weathering)


def _own_labels(evaluated: Evaluated, index: int) -> list[float]:
    weathering = _weathering(evaluated, index)
    return evaluated.config.conditions.labels(weathering.amount, weathering.recipe)


def _weathering(evaluated: Evaluated, index: int) -> SceneWeathering:
    weathering = evaluated.source.exemplars.scenes[index].weathering
    assert isinstance(weathering, SceneWeathering)
    return weathering


def _drawn(evaluated: Evaluated, index: int, seed: int, labels: Sequence[float]) -> Picture:
    return _upright(evaluated, index, _draw(evaluated, index, seed, labels))


def _draw(evaluated: Evaluated, index: int, seed: int, labels: Sequence[float]) -> Layer:
    """The generator's layer on the subject of an exemplar, on the CPU."""
    assert evaluated.generator is not None
    with torch.no_grad():
        painted = Draw(evaluated.generator, seed, labels).on(evaluated.source.inputs([index]))[0]
    return Layer(painted.cpu().float(), evaluated.generator.maps)


def _upright(evaluated: Evaluated, index: int, layer: Layer) -> Picture:
    return upright(over_checker(layer), evaluated.source.exemplars.subject(index).learnable_texels)
