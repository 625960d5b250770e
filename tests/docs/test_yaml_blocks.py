"""The YAML files that docs/quickstart.md and docs/commands.md show are valid; the table of recipes is complete."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from svbrdfgan.config.models import validate
from svbrdfgan.data.conditions import declared_conditions
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.models.shipped import shipped_models
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.networks.layers import LOCAL_NORMS
from svbrdfgan.training.config import train_config
from svbrdfgan.weathering.recipes import RECIPES

OPTION = re.compile(r"^\| ([a-z-]* ?)\| `(\w+)` \| `([\d.]+)` \| ([\d.]+) to ([\d.]+) \|", re.MULTILINE)
Blocks = list[dict[str, Any]]


@pytest.fixture
def quickstart(code_blocks: Callable[[str, str], list[str]]) -> Blocks:
    return [yaml.safe_load(block) for block in code_blocks("docs/quickstart.md", "yaml")]


@pytest.fixture
def commands(code_blocks: Callable[[str, str], list[str]]) -> Blocks:
    return [yaml.safe_load(block) for block in code_blocks("docs/commands.md", "yaml")]


def dataset_of(quickstart: Blocks, **changed: Any) -> DatasetConfig:
    return validate(DatasetConfig, {**quickstart[0], **changed}, "dataset.yaml")


def test_the_two_files_of_the_quickstart(quickstart: Blocks) -> None:
    assert set(dataset_of(quickstart).splits) == {"train", "validation", "test"}
    assert train_config(quickstart[1], "train.yaml").dataset == "data/cars"
    assert len(quickstart) == 2


def test_a_distribution_has_random_fields_and_conditions(quickstart: Blocks, commands: Blocks) -> None:
    varied, train = commands[:2]
    known = declared_conditions(dataset_of(quickstart, **varied).weathering)
    assert known == Conditions((0.1, 1.0), ("smooth-rust", "smooth-dirt"))
    assert train_config(train, "train.yaml").generator.conditional


def test_close_ups_have_texels_to_show(quickstart: Blocks, commands: Blocks) -> None:
    close, train, refining, quiet, faint = commands[2:7]
    near = dataset_of(quickstart, **close)
    assert near.camera.close_ups is not None
    assert near.texture >= 2048
    for each in (train, refining):
        assert train_config({"dataset": "data/cars", **each}, "train.yaml").generator.norm in LOCAL_NORMS
    assert refining["refines"] in shipped_models()
    assert train_config({"dataset": "data/cars", **refining, **quiet}, "train.yaml").clean_spp == 4096
    octaves = train_config({"dataset": "data/cars", **refining, **faint}, "train.yaml")
    assert octaves.discriminator.octaves > 0
    assert (octaves.spp, octaves.hits, octaves.clean_spp) == (64, 64, None)  # of exemplars with 64 samples


def test_fakes_of_whole_materials_have_the_samples_of_their_exemplars(quickstart: Blocks, commands: Blocks) -> None:
    materials, train = commands[7:9]
    whole, fakes = dataset_of(quickstart, **materials), train_config(train, "train.yaml")
    assert set(whole.maps) == {"roughness", "metallic", "normal"}
    assert fakes.hits >= fakes.spp == whole.spp  # else their noise would tell them from exemplars


def test_pictures_of_a_model_have_labels(quickstart: Blocks, commands: Blocks) -> None:
    (painted,) = commands[9:]
    labelled = dataset_of(quickstart, **painted)
    assert labelled.weathering is not None
    assert (labelled.weathering.model, len(labelled.labels)) == ("runs/cars", 4)


def test_every_option_of_every_recipe_is_explained(repository: Path) -> None:
    text = (repository / "docs" / "commands.md").read_text(encoding="utf-8")
    told, recipe = {}, ""
    for name, option, *numbers in re.findall(OPTION, text):
        recipe = name.strip() or recipe
        for each in RECIPES if recipe == "all" else [recipe]:
            told[each, option] = tuple(map(float, numbers))
    assert told == {
        (name, spec.name): (spec.default, spec.metadata["least"], spec.metadata["greatest"])
        for name, recipe_type in RECIPES.items()
        for spec in dataclasses.fields(recipe_type)
        if spec.name not in ("amount", "seed")  # keys of their own
    }
