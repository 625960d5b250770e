"""A data set whose layers paint whole materials."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.data.config import dataset_config
from svbrdfgan.data.exemplars import Exemplars, load_exemplars
from svbrdfgan.data.generate import generate
from svbrdfgan.data.index import Dataset


@pytest.fixture(scope="session")
def glossy_dataset(
    dataset_data: Callable[..., dict[str, Any]], built_once: Callable[[str, Callable[[Path], None]], Path]
) -> Path:
    """Two procedural vehicles with chipped paint, in two small pictures each. Not to be changed."""
    data = dataset_data(
        maps={"roughness": 0.4, "metallic": 0.0, "normal": 0.0},
        image=[24, 24],
        spp=4,
        weathering={"recipe": "chipped-paint"},
        splits={"train": {"views": 2}, "validation": {"views": 1}},
    )

    def fill(folder: Path) -> None:
        generate(dataset_config(data, "here"), folder / "dataset", base=Path())

    return built_once("glossy", fill) / "dataset"


@pytest.fixture(scope="session")
def glossy_exemplars(glossy_dataset: Path) -> Exemplars:
    """Its training split in memory. Not to be changed."""
    return load_exemplars(Dataset.open(glossy_dataset), "train")
