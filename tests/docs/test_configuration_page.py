"""docs/configuration.md is what the configuration models say, and the files that docs/quickstart.md shows are valid."""

import dataclasses
import re
import runpy
from pathlib import Path
from typing import Any

import pytest
import yaml

from svbrdfgan.config.models import validate
from svbrdfgan.data.conditions import declared_conditions
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.networks import Conditions
from svbrdfgan.training.config import train_config
from svbrdfgan.weathering import RECIPES

ROW = re.compile(r"^\| `([^`]+)` \| (.+?) \| (.+?) \| (.+) \|$", re.MULTILINE)
OPTION = re.compile(r"^\| ([a-z-]* ?)\| `(\w+)` \| `([\d.]+)` \| ([\d.]+) to ([\d.]+) \|", re.MULTILINE)


@pytest.fixture(scope="module")
def maker(repository: Path) -> dict[str, Any]:
    """The names of the script that makes the page."""
    return runpy.run_path(str(repository / "docs" / "make_configuration.py"))


def test_the_page_is_what_the_models_say(maker: dict[str, Any]) -> None:
    told = maker["PAGE"].read_text(encoding="utf-8")
    assert told == maker["page"](), "make the page again: python docs/make_configuration.py"


def test_every_key_has_a_meaning(maker: dict[str, Any]) -> None:
    rows = ROW.findall(maker["page"]())
    assert len(rows) > 100
    assert [key for key, _, _, meaning in rows if meaning in ("None", "")] == []


def test_defaults_are_written_as_users_write_them(maker: dict[str, Any]) -> None:
    data: dict[str, dict[str, Any]] = {
        "`dataset.yaml`": {"splits": {"train": {"meshes": {"procedural": {"count": 1}}}}},
        "`train.yaml`": {"dataset": "data"},
    }
    for title, least in data.items():
        table = maker["page"]().split(f"## {title}\n")[1].split("\n#")[0]
        told = {
            key: yaml.safe_load(default.strip("`")) for key, _, default, _ in ROW.findall(table) if key not in least
        }
        model = maker["FILES"][title]
        assert validate(model, {**least, **told}, "page") == validate(model, least, "page")


def test_every_option_of_every_recipe_is_explained(repository: Path) -> None:
    text = (repository / "docs" / "quickstart.md").read_text(encoding="utf-8")
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


def test_the_files_shown_are_valid(repository: Path) -> None:
    text = (repository / "docs" / "quickstart.md").read_text(encoding="utf-8")
    blocks = [yaml.safe_load(block) for block in re.findall(r"^```yaml\n(.*?)^```", text, re.M | re.S)]
    dataset, train, varied, train_varied, materials, train_materials, painted = blocks
    assert set(validate(DatasetConfig, dataset, "dataset.yaml").splits) == {"train", "validation", "test"}
    assert train_config(train, "train.yaml").dataset == "data/cars"
    known = declared_conditions(validate(DatasetConfig, {**dataset, **varied}, "dataset.yaml").weathering)
    assert known == Conditions((0.1, 1.0), ("rust", "road-dirt"))
    assert train_config(train_varied, "train.yaml").generator.conditional
    whole = validate(DatasetConfig, {**dataset, **materials}, "dataset.yaml")
    assert set(whole.maps) == {"roughness", "metallic", "normal"}
    fakes = train_config(train_materials, "train.yaml")
    assert fakes.hits >= fakes.spp == whole.spp  # else their noise would tell them from exemplars
    labelled = validate(DatasetConfig, {**dataset, **painted}, "dataset.yaml")
    assert labelled.weathering is not None
    assert (labelled.weathering.model, len(labelled.labels)) == ("runs/cars", 4)
