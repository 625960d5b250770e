"""The shipped experiments: each says what it is, and is right in both profiles by every recipe it names."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from svbrdfgan.config.distributions import Uniform
from svbrdfgan.data.config import EnvironmentSource
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.definition import ProfileName, experiment_names, load_experiment, load_profile
from svbrdfgan.experiments.run_matrix import Cell, RunMatrix, select_cells
from svbrdfgan.training.config import RECIPES, train_config

NAMES = experiment_names()
PROFILES: tuple[ProfileName, ...] = ("cpu", "gpu")


def cell(experiment: str, row: str, profile: ProfileName = "gpu") -> Cell:
    return RunMatrix.load(experiment, profile).cell(row, "default", 0)


def test_the_names() -> None:
    wanted = "backward-samples batch-size detail embedding environment loss meshes pose-noise recipe samples"
    assert [*wanted.split(), "training", "variety"] == NAMES


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize("name", NAMES)
def test_every_run_is_possible_and_like_no_other(name: str, profile: ProfileName) -> None:
    cells = RunMatrix.load(name, profile).cells()
    specs = [cell.spec.model_dump_json() for cell in cells]
    assert len(set(specs)) == len(specs)
    assert all(cell.spec.train.minutes for cell in cells)
    assert all({"train", "validation", "test"} == set(cell.spec.dataset.splits) for cell in cells)
    assert {cell.spec.train.recipe for cell in cells} == {cell.recipe for cell in cells}


@pytest.mark.parametrize("name", NAMES)
def test_every_row_says_what_it_is(name: str) -> None:
    experiment = load_experiment(name)
    assert experiment.title
    assert experiment.figure
    for text in (experiment.thesis, *(row.about for row in experiment.rows.values())):
        assert text.strip().endswith(".")


@pytest.mark.parametrize("profile", PROFILES)
def test_a_profile_leaves_the_recipes_as_they_are(profile: ProfileName) -> None:
    """What a recipe sets, and what the discriminator and the loss are, is not the profile's to say, but for widths.

    Augmentation came after the published tables, and is left out.
    """
    base = load_profile(profile).train
    widths = {f"{group}.width" for group in ("generator", "discriminator")}
    said = {f"{group}.{key}" for group in RECIPES["thesis"] for key in dict(base.get(group, {}))}
    assert said <= widths | {"discriminator.augment"}
    thesis = RunMatrix.load("training", profile).cell("matched", "thesis", 0).spec.train
    alone = train_config({"dataset": "d", "recipe": "thesis"}, "alone")
    assert (thesis.loss, thesis.optimizer, thesis.batch_size) == (alone.loss, alone.optimizer, 1)
    if profile == "gpu":
        assert (thesis.generator, thesis.discriminator) == (alone.generator, alone.discriminator)


@pytest.mark.parametrize(
    ("experiment", "row"),
    [
        ("training", "matched"),
        ("pose-noise", "noise-10"),
        ("pose-noise", "disjoint"),
        ("environment", "redrawn"),
        ("environment", "disjoint"),
        ("samples", "fakes-16"),
    ],
)
def test_what_is_promised_takes_three_seeds(experiment: str, row: str) -> None:
    cells = select_cells(RunMatrix.load(experiment, "gpu").cells(), [f"{experiment}/{row}"])
    assert [c.seed for c in cells if c.recipe == "default"] == [0, 1, 2]
    assert [c.seed for c in cells if c.recipe == "thesis"] == [0]


@pytest.mark.parametrize("profile", PROFILES)
def test_disjoint_poses_do_not_overlap(profile: ProfileName) -> None:
    spec = cell("pose-noise", "disjoint", profile).spec
    assert spec.train.scenes.camera is not None
    real, fake = spec.dataset.camera_of("train").elevation_degrees, spec.train.scenes.camera.elevation_degrees
    assert isinstance(real, Uniform)
    assert isinstance(fake, Uniform)
    assert real.uniform[1] < fake.uniform[0]


@pytest.mark.parametrize("profile", PROFILES)
@pytest.mark.parametrize(("experiment", "row"), [("pose-noise", "disjoint"), ("training", "one-sided")])
def test_what_few_cameras_trained_is_tested_by_all(experiment: str, row: str, profile: ProfileName) -> None:
    few, all_round = (cell(*names, profile).spec.dataset for names in ((experiment, row), ("training", "matched")))
    assert few.camera_of("train") != all_round.camera_of("train")
    for split in ("validation", "test"):
        assert (few.camera_of(split), few.splits[split]) == (all_round.camera_of(split), all_round.splits[split])


def test_disjoint_lights_share_no_map() -> None:
    spec = cell("environment", "disjoint").spec
    assert isinstance(spec.train.scenes.environment, EnvironmentSource)
    assert not set(spec.train.scenes.environment.files) & set(spec.dataset.environments.files)
    small = cell("environment", "disjoint", "cpu").spec
    assert isinstance(small.train.scenes.environment, EnvironmentSource)
    skies, rooms = small.dataset.environments.procedural, small.train.scenes.environment.procedural
    assert skies is not None
    assert rooms is not None
    assert (skies.kind, rooms.kind) == ("outdoor", "indoor")


def test_what_the_rows_of_samples_say() -> None:
    pairs = {
        row: (spec.dataset.spp, spec.train.spp)
        for row in load_experiment("samples").rows
        for spec in [cell("samples", row).spec]
    }
    assert pairs["fakes-16"] == (256, 16)
    assert pairs["exemplars-16"] == (16, 256)
    assert pairs["both-16"] == (16, 16)


@pytest.mark.parametrize("profile", PROFILES)
def test_the_other_renderer_is_another(profile: ProfileName) -> None:
    spec = cell("training", "other-renderer", profile).spec
    assert {spec.dataset.renderer.name, spec.train.renderer.name} == {"warp", "mitsuba"}


@pytest.mark.parametrize("profile", PROFILES)
def test_the_matched_run_is_one_for_all_experiments(profile: ProfileName) -> None:
    rows = {"training": "matched", "pose-noise": "noise-0", "environment": "matched", "loss": "recipe"}
    rows |= {"embedding": "hemispherical", "batch-size": "batch-16", "meshes": "all", "recipe": "ours"}
    specs = {cell(experiment, row, profile).spec.model_dump_json() for experiment, row in rows.items()}
    assert len(specs) == 1


@pytest.mark.assets
def test_the_vehicles_and_lights_are_those_of_the_split(assets: Path) -> None:
    split = json.loads((assets / "split.json").read_text())
    spec = cell("environment", "disjoint").spec
    for name, source in spec.dataset.splits.items():
        assert {Path(file).stem for file in source.meshes.files} == set(split["vehicles"][name])
    assert {Path(file).stem for file in spec.dataset.environments.files} == set(split["environments"]["a"])
    assert isinstance(spec.train.scenes.environment, EnvironmentSource)
    assert {Path(file).stem for file in spec.train.scenes.environment.files} == set(split["environments"]["b"])
    every = {file for name in NAMES for c in RunMatrix.load(name, "gpu").cells() for file in c.spec.files}
    assert [file for file in every if not (assets / file).is_file()] == []
    trained = {
        f
        for name in NAMES
        for c in RunMatrix.load(name, "gpu").cells()
        for f in c.spec.dataset.splits["train"].meshes.files
    }
    assert {Path(file).stem for file in trained} == set(split["vehicles"]["train"])


def test_an_experiment_that_is_not_there() -> None:
    with pytest.raises(ConfigError, match=r"there is no experiment 'trainin'; did you mean 'training'\?"):
        load_experiment("trainin")
    with pytest.raises(ConfigError, match=r"known are .*pose-noise.*, or give the path of a YAML file"):
        load_experiment("zebra")
