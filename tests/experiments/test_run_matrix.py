"""How rows come to their configurations: profile, experiment, user and row, each over the one before."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from svbrdfgan.config.models import validate
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.run_matrix import OracleSpec, RunMatrix, RunSpec, select_cells

MakeMatrix = Callable[..., RunMatrix]


def test_rows_are_crossed_with_recipes_and_seeds(make_matrix: MakeMatrix) -> None:
    made = [(cell.row, cell.recipe, cell.seed) for cell in make_matrix().cells()]
    assert made == [
        *(("none", "default", 0), ("none", "default", 1), ("none", "thesis", 0)),
        *(("some", "default", 0), ("some", "default", 1), ("some", "thesis", 0)),
        ("fewer", "default", 0),
    ]


def test_rows_and_seeds_may_be_chosen(make_matrix: MakeMatrix) -> None:
    chosen = select_cells(make_matrix().cells([7]), ["noise/fewer", "*/n*/thesis", "*/none"])
    made = [(cell.row, cell.recipe, cell.seed) for cell in chosen]
    assert made == [("fewer", "default", 7), ("none", "thesis", 7), ("none", "default", 7)]


def test_a_profile_limits_the_seeds(make_matrix: MakeMatrix) -> None:
    matrix = make_matrix()
    one = RunMatrix(matrix.name, matrix.experiment, "cpu", matrix.profile.model_copy(update={"seeds": 1}))
    assert {cell.seed for cell in one.cells()} == {0}


def test_each_layer_goes_over_the_one_before(make_matrix: MakeMatrix) -> None:
    rows = {
        "plain": {"about": "."},
        "row": {"about": ".", "train": {"spp": 4}, "cpu": {"train": {"score_every": 6}}, "gpu": {"train": {"spp": 9}}},
    }
    matrix = make_matrix("train.spp=3", "train.batch_size=5", train={"spp": 2, "score_every": 7}, rows=rows)
    plain, row = (matrix.cell(name, "thesis", 0).spec.train for name in ("plain", "row"))
    assert (plain.spp, plain.score_every, plain.batch_size) == (3, 7, 5)
    assert (row.spp, row.score_every, row.batch_size) == (4, 6, 5)
    assert (plain.loss.name, plain.generator.width) == ("wgan", matrix.profile.train["generator"]["width"])


def test_a_changed_value_is_changed_whole(make_matrix: MakeMatrix) -> None:
    """A distribution that is replaced leaves nothing of the one before."""
    rows = {"row": {"about": ".", "dataset": {"environments": {"procedural": {"count": 3}}}}}
    changed = make_matrix("dataset.camera.elevation_degrees=7", rows=rows).cell("row", "default", 0).spec.dataset
    assert changed.environments.procedural is not None
    assert (changed.environments.procedural.count, changed.environments.procedural.seed) == (3, 0)
    assert changed.camera.elevation_degrees.model_dump() == {"fixed": 7.0}


def test_every_split_is_wanted(make_matrix: MakeMatrix) -> None:
    matrix = make_matrix("dataset.splits={train: {meshes: {procedural: {count: 1}}}}")
    with pytest.raises(ConfigError, match=r"row none: dataset\.splits lacks validation and test"):
        matrix.cells()


def test_an_oracle_depends_on_data_and_generator_alone(make_matrix: MakeMatrix) -> None:
    matrix = make_matrix(train={"scenes.pool": 2})
    oracles = {(cell.row, cell.recipe, cell.seed): cell.spec.oracle for cell in matrix.cells()}
    assert oracles["none", "default", 0] == oracles["none", "default", 1] == oracles["some", "default", 0]
    assert oracles["none", "default", 0] != oracles["fewer", "default", 0]  # other data
    assert oracles["none", "default", 0] != oracles["none", "thesis", 0]  # another generator
    assert oracles["none", "thesis", 0] == oracles["some", "thesis", 0]
    assert {oracle.train.steps for oracle in oracles.values()} == {1}
    other = make_matrix(name="other", train={"batch_size": 2})
    assert other.cell("none", "default", 0).spec.oracle == oracles["none", "default", 0]


def test_the_oracle_of_a_distribution_trains_as_its_runs_do(make_matrix: MakeMatrix) -> None:
    seeds = {"dataset": {"weathering.seed": {"uniform": [0, 9]}}, "train": {"generator.random_fields": 2}}
    rows = {
        "drawn": {"about": ".", **seeds},
        "lsgan": {
            "about": ".",
            "dataset": seeds["dataset"],
            "train": {"generator.random_fields": 2, "loss.name": "lsgan"},
        },
        "fixed": {"about": ".", "train": seeds["train"]},
        "even": {"about": ".", "dataset": seeds["dataset"]},
    }
    cells = {
        (cell.row, cell.seed): cell.spec
        for cell in make_matrix("train.minutes=2", rows=rows, recipes={"default": [0, 1]}).cells()
    }
    drawn = cells["drawn", 0]
    assert drawn.oracle == cells["drawn", 1].oracle
    assert (drawn.oracle.steps, drawn.oracle.minutes) == (drawn.train.steps, 2)
    assert (drawn.oracle.train.steps, drawn.oracle.train.minutes) == (1, None)
    assert drawn.oracle.train.discriminator == drawn.train.discriminator
    assert cells["lsgan", 0].oracle.train.loss.name == "lsgan"
    for row in ("fixed", "even"):  # regression finds the one layer, or what is best without random fields
        assert cells[row, 0].oracle.minutes is None
        assert cells[row, 0].oracle.steps == make_matrix().profile.oracle_steps


def test_specifications_survive_json(make_matrix: MakeMatrix) -> None:
    spec = make_matrix().cell("some", "thesis", 1).spec
    assert RunSpec.model_validate_json(spec.model_dump_json()) == spec
    assert validate(OracleSpec, spec.oracle.model_dump(mode="json"), "here") == spec.oracle


def test_the_files_that_a_run_needs() -> None:
    spec = RunMatrix.load("environment", "gpu").cell("disjoint", "default", 0).spec
    for wanted in (
        "cars/kenney_suv.glb",
        "cars/kaykit_sedan.glb",
        "envmaps/pmndrs_park.hdr",
        "envmaps/pmndrs_night.hdr",
    ):
        assert wanted in spec.files
    assert RunMatrix.load("environment", "cpu").cell("disjoint", "default", 0).spec.files == []


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rows": {"a": {"about": ".", "train": {"spp": 0}}}}, "noise, row a: spp: 0 is not allowed"),
        ({"rows": {"a": {"about": ".", "dataset": {"spq": 1}}}}, "unknown key 'spq'; did you mean 'spp'"),
        ({"rows": {"a": {"about": ".", "training": {}}}}, "unknown key 'training'; did you mean 'train'"),
        ({"rows": {}}, "rows"),
        ({"measures": ["unseeen"]}, "did you mean 'unseen'"),
        ({"recipes": {"mine": [0]}}, "recipes"),
    ],
)
def test_a_mistake_in_a_file_is_one_line(make_matrix: MakeMatrix, changes: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        make_matrix(**changes).cells()
    assert len(str(caught.value).splitlines()) == 1


def test_a_mistake_on_the_command_line_is_one_line(make_matrix: MakeMatrix) -> None:
    with pytest.raises(ConfigError, match=r"'steps=3' changes nothing here; keys begin with 'dataset\.' or 'train\.'"):
        make_matrix("steps=3")
    cells = make_matrix().cells()
    with pytest.raises(ConfigError, match=r"no run matches 'noise/nonne'; did you mean 'noise/none'\?"):
        select_cells(cells, ["noise/nonne"])
    with pytest.raises(ConfigError, match=r"no run matches 'x/y/z'; there are noise/none, noise/some, noise/fewer\."):
        select_cells(cells, ["x/y/z"])


def test_a_file_of_ones_own_is_named_by_its_stem(make_matrix: MakeMatrix, tmp_path: Path) -> None:
    assert make_matrix().name == "noise"
    assert yaml.safe_load((tmp_path / "noise.yaml").read_text())["title"] == "Noise"
