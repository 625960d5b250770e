"""True draws of vehicles: the same in one process and in several, and new for each vehicle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.exemplar_files import exemplar_paths
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.true_draws import Vehicle, paint, paint_all
from svbrdfgan.scene.description import Scene


@pytest.fixture(scope="module")
def vehicle(dataset_data: Callable[..., dict[str, Any]], built_once: Any) -> Vehicle:
    weathering = {"recipe": "rust", "amount": {"uniform": [0.4, 1]}, "seed": {"uniform": [0, 9999]}}
    data = dataset_data(spp=1, weathering=weathering)
    folder = built_once("true draws", lambda f: generate(dataset_config(data, "here"), f, base=Path()) and None)
    scenes = tuple(Scene.load(exemplar_paths(folder, "train", number)[1]) for number in (0, 0))
    declared = Dataset.open(folder).config.weathering
    assert declared is not None
    return Vehicle(folder, 0, scenes, declared, (("rust", (0.4, 1.0)),))


def test_all_layers_of_a_vehicle_differ_and_each_vehicle_has_its_own(vehicle: Vehicle) -> None:
    drawn, other = paint(vehicle), paint(replace(vehicle, number=1))
    assert len(np.unique(drawn.layers, axis=0)) == len(drawn.layers) == 4
    assert not np.array_equal(drawn.layers, other.layers)
    assert drawn.area.sum() == pytest.approx(1.0, abs=1e-5)
    assert drawn.amounts[0].shape == (2,)
    assert drawn.amounts[0][0] < drawn.amounts[0][1]


@pytest.mark.full
def test_several_processes_paint_the_same(vehicle: Vehicle) -> None:
    vehicles = [vehicle, replace(vehicle, number=1)]
    for alone, spread in zip(paint_all(vehicles, 1), paint_all(vehicles, 2), strict=True):
        np.testing.assert_array_equal(alone.layers, spread.layers)
        np.testing.assert_array_equal(alone.area, spread.area)
        np.testing.assert_array_equal(alone.amounts, spread.amounts)
