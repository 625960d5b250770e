"""The tables of docs/quickstart.md list exactly the keys of the two configuration files, with their defaults."""

import dataclasses
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel

from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.config.distributions import Choice, Fixed, Normal, Uniform
from svbrdfgan.config.models import validate
from svbrdfgan.config.yaml_files import apply_overrides
from svbrdfgan.data.conditions import declared_conditions
from svbrdfgan.data.config import DatasetConfig
from svbrdfgan.networks.conditions import Conditions
from svbrdfgan.training.config import TrainConfig, train_config
from svbrdfgan.weathering.recipes import RECIPES

ROW = re.compile(r"^\| `([^`]+)` \| (.+?) \| .+ \|$", re.MULTILINE)
OPTION = re.compile(r"^\| ([a-z-]* ?)\| `(\w+)` \| `([\d.]+)` \| ([\d.]+) to ([\d.]+) \|", re.MULTILINE)
DISTRIBUTIONS = (Fixed, Choice, Uniform, Normal)

# The smallest data that have every mapping which contains a documented key.
DATASET: dict[str, Any] = {
    "environments": {"procedural": {"count": 8}},
    "splits": {"train": {"meshes": {"procedural": {"count": 1}}}},
}
TRAIN: dict[str, Any] = {"dataset": "data"}


def records(annotation: Any) -> Iterator[type[BaseModel]]:
    """The configuration records in an annotation, also nested. Distributions and plugin choices count as values."""
    is_record = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    if is_record and not issubclass(annotation, (*DISTRIBUTIONS, PluginChoice)):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from records(argument)


def keys(model: type[BaseModel], explained: set[type[BaseModel]]) -> list[str]:
    """The dotted keys below a record, without those of records that are explained elsewhere."""
    found = list(model.model_fields)
    below = {r: name for name, field in reversed(model.model_fields.items()) for r in records(field.annotation)}
    fresh = {record: name for record, name in below.items() if record not in explained}
    explained |= set(fresh)
    for record, name in fresh.items():
        prefix = f"{name}.train." if name == "splits" else f"{name}."
        found += [prefix + key for key in keys(record, explained)]
    return found


@pytest.fixture(scope="module")
def tables(repository: Path) -> tuple[dict[str, str], dict[str, str]]:
    """Key and default of each row, of `dataset.yaml` and of `train.yaml`."""
    text = (repository / "docs" / "quickstart.md").read_text(encoding="utf-8")
    dataset, train = text.split("### Every key of `train.yaml`")
    return dict(ROW.findall(dataset)), dict(ROW.findall(train))


def test_every_key_is_explained(tables: tuple[dict[str, str], dict[str, str]]) -> None:
    explained: set[type[BaseModel]] = set()
    assert sorted(tables[0]) == sorted(keys(DatasetConfig, explained))
    assert sorted(tables[1]) == sorted(keys(TrainConfig, explained))


def test_an_unexplained_key_is_found() -> None:
    class Inner(BaseModel):
        deep: int = 0

    class Outer(BaseModel):
        inner: Inner | None = None
        other: Inner = Inner()

    assert keys(Outer, set()) == ["inner", "other", "inner.deep"]


def test_defaults_are_those_of_the_code(tables: tuple[dict[str, str], dict[str, str]]) -> None:
    def same(key: str, default: str, data: dict[str, Any], dataset: bool) -> bool:
        told = default.strip("`")
        check = (lambda d: validate(DatasetConfig, d, "docs")) if dataset else (lambda d: train_config(d, "docs"))
        if told == "null" and key.endswith("procedural"):
            return bool(_below(data, key))  # the minimal data set it, because it contains other keys
        return bool(check(apply_overrides(data, [f"{key}={told}"])) == check(data))

    for table, data, dataset in ((tables[0], DATASET, True), (tables[1], TRAIN, False)):
        wrong = [k for k, default in table.items() if default.startswith("`") and not same(k, default, data, dataset)]
        assert wrong == []


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


def test_the_required_keys_are_required(tables: tuple[dict[str, str], dict[str, str]]) -> None:
    required = {key for key, default in {**tables[0], **tables[1]}.items() if default == "required"}
    assert required == {
        *("splits", "splits.train.meshes", "splits.train.meshes.procedural.count"),
        *("environments.procedural.count", "dataset"),
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


def _below(data: dict[str, Any], key: str) -> Any:
    value: Any = data
    for name in key.split("."):
        value = value[name]
    return value
