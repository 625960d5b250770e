"""Relit FLIP of draws: 0 for equal draws, about 1 for other true ones, and more for what true draws never look like."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from svbrdfgan.data.exemplars import Exemplars
from svbrdfgan.data.index import Dataset
from svbrdfgan.evaluation.record import Painter
from svbrdfgan.evaluation.relight import Relight, Relighter
from svbrdfgan.evaluation.relit_draws import DrawRelighter
from svbrdfgan.metrics.draw_figures import relit_figures
from svbrdfgan.protocols import Renderer
from svbrdfgan.scene.description import SceneWeathering
from svbrdfgan.types import Layer


@pytest.fixture(scope="module")
def relighter(glossy_exemplars: Exemplars, glossy_dataset: Path, cpu_renderer: Renderer[Any]) -> DrawRelighter:
    index = Dataset.open(glossy_dataset).index
    found = Relighter.make(Relight(), index)
    return DrawRelighter.make(found, glossy_exemplars, index.sampler("train"), cpu_renderer)


@pytest.fixture(scope="module")
def draws(glossy_exemplars: Exemplars) -> Callable[[int], Layer]:
    """Four true draws of the first vehicle, with other seeds for each number."""

    def drawn(number: int) -> Layer:
        scene = glossy_exemplars.scenes[0]
        assert isinstance(scene.weathering, SceneWeathering)
        own = [scene.weathering.model_copy(update={"seed": 10 * number + n}) for n in range(4)]
        layers = [glossy_exemplars.loader.paint(scene, weathering) for weathering in own]
        return replace(layers[0], values=torch.stack([layer.values for layer in layers]))

    return drawn


def test_scenes_have_lights_and_views_of_their_own(
    relighter: DrawRelighter, glossy_exemplars: Exemplars, glossy_dataset: Path
) -> None:
    trained = {light.asset.sha256 for light in Dataset.open(glossy_dataset).index.environments["train"]}
    assert sorted(relighter.scenes) == [0, 1]
    for subject, scenes in relighter.scenes.items():
        own = [glossy_exemplars.scenes[view] for view in glossy_exemplars.views_of(subject)]
        assert [scene.weathering for scene in scenes] == [scene.weathering for scene in own] * 2
        assert len({scene.camera.azimuth_degrees for scene in (*scenes, *own)}) == 6
        assert not trained & {scene.environment.asset.sha256 for scene in scenes}


def test_other_true_draws_are_as_far_and_wrong_ones_further(
    relighter: DrawRelighter, draws: Callable[[int], Layer]
) -> None:
    truth = draws(0)
    wrong = replace(truth, values=torch.tensor([0.9, 0.1, 0.8, 1.0, 0.1, 0.9, 0.3, 0.0, 0.95]).expand_as(truth.values))
    others: dict[Painter, Layer] = {"truth": draws(1), "generated": draws(2), "constant": wrong, "oracle": truth}
    flips = relighter.flips(0, truth, others)
    assert flips["oracle"] == [0.0] * 4, "equal draws have pictures of the same random numbers"
    found = {name: relit_figures(flips["truth"], flips[name]) for name in ("generated", "constant", "oracle")}
    ratios = {name: figures.ratio for name, figures in found.items() if figures is not None}
    assert ratios["generated"] == pytest.approx(1.0, abs=0.25)
    assert ratios["constant"] > 2.0
    assert ratios["oracle"] == 0.0
    assert found["generated"] is not None
    assert found["generated"].pairs == 4


def test_vehicles_that_are_not_chosen_are_not_rendered(relighter: DrawRelighter, draws: Callable[[int], Layer]) -> None:
    assert replace(relighter, scenes={}).flips(0, draws(0), {"truth": draws(1)}) == {}


def test_draws_that_never_differ_have_no_ratio() -> None:
    assert relit_figures([0.0, 0.0], [0.1, 0.2]) is None
    assert relit_figures([], []) is None
