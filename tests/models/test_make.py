"""The configurations that the shipped models are made of: valid, small enough, and of vehicles that are free to use."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from svbrdfgan.config.yaml_files import load_yaml
from svbrdfgan.data.config import dataset_config
from svbrdfgan.networks.saved import make_generator
from svbrdfgan.training.config import train_config
from svbrdfgan.training.ship import LARGEST

MODELS = Path(__file__).parents[2] / "examples" / "models"
FREE = ("CC0 1.0", "CC BY 3.0", "CC BY 4.0", "MIT")


def test_the_networks_fit_into_the_package() -> None:
    data = dataset_config(load_yaml(MODELS / "dataset.yaml"), "dataset.yaml")
    training = train_config(load_yaml(MODELS / "train.yaml"), "train.yaml")
    generator = make_generator(training.generator, tuple(data.maps), labels=1)
    weights = 2 * sum(parameter.numel() for parameter in generator.parameters())
    assert data.texture >= 512
    assert weights < 0.9 * LARGEST
    assert 5 * weights < 39_000_000  # five recipes, in a wheel of 40 MB


@pytest.mark.parametrize("split", ["train", "validation", "test"])
def test_vehicles_are_free_and_on_their_side_of_the_split(split: str, assets: Path) -> None:
    data = dataset_config(load_yaml(MODELS / "dataset.yaml"), "dataset.yaml")
    used = {Path(name).stem for name in data.splits[split].meshes.files}  # type: ignore[index]
    assert used == set(json.loads((assets / "split.json").read_text())["vehicles"][split])
    with (assets / "MANIFEST.tsv").open(encoding="utf-8", newline="") as file:
        licences = {Path(row["file"]).stem: row["licence"] for row in csv.DictReader(file, delimiter="\t")}
    skies = {Path(name).stem for name in data.environments.files}
    wrong = {name: licences[name] for name in used | skies if not licences[name].startswith(FREE)}
    assert wrong == {}
