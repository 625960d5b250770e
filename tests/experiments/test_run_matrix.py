"""How rows come to their configurations: profile, experiment, user and row, each over the one before."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from svbrdfgan.config.models import validate
from svbrdfgan.errors import ConfigError
from svbrdfgan.experiments.run_matrix import Design, OracleSpec, RunSpec, choose

MakeDesign = Callable[..., Design]


def test_rows_are_crossed_with_recipes_and_seeds(make_design: MakeDesign) -> None:
    made = [(cell.row, cell.recipe, cell.seed) for cell in make_design().cells()]
    assert made == [
        *(("none", "default", 0), ("none", "default", 1), ("none", "thesis", 0)),
        *(("some", "default", 0), ("some", "default", 1), ("some", "thesis", 0)),
        ("fewer", "default", 0),
    ]


def test_rows_and_seeds_may_be_chosen(make_design: MakeDesign) -> None:
    chosen = choose(make_design().cells([7]), ["noise/fewer", "*/n*/thesis", "*/none"])
    made = [(cell.row, cell.recipe, cell.seed) for cell in chosen]
    assert made == [("fewer", "default", 7), ("none", "thesis", 7), ("none", "default", 7)]


def test_a_profile_limits_the_seeds(make_design: MakeDesign) -> None:
    design = make_design()
    one = Design(design.name, design.experiment, "cpu", design.profile.model_copy(update={"seeds": 1}))
    assert {cell.seed for cell in one.cells()} == {0}


def test_each_layer_goes_over_the_one_before(make_design: MakeDesign) -> None:
    rows = {
        "plain": {"about": "."},
        "row": {"about": ".", "train": {"spp": 4}, "cpu": {"train": {"score_every": 6}}, "gpu": {"train": {"spp": 9}}},
    }
    design = make_design("train.spp=3", "train.batch_size=5", train={"spp": 2, "score_every": 7}, rows=rows)
    plain, row = (design.cell(name, "thesis", 0).spec.train for name in ("plain", "row"))
    assert (plain.spp, plain.score_every, plain.batch_size) == (3, 7, 5)
    assert (row.spp, row.score_every, row.batch_size) == (4, 6, 5)
    assert (plain.loss.name, plain.generator.width) == ("wgan", design.profile.train["generator"]["width"])


def test_a_changed_value_is_changed_whole(make_design: MakeDesign) -> None:
    """A distribution that is replaced leaves nothing of the one before."""
    rows = {"row": {"about": ".", "dataset": {"environments": {"procedural": {"count": 3}}}}}
    changed = make_design("dataset.camera.elevation_degrees=7", rows=rows).cell("row", "default", 0).spec.dataset
    assert changed.environments.procedural is not None
    assert (changed.environments.procedural.count, changed.environments.procedural.seed) == (3, 0)
    assert changed.camera.elevation_degrees.model_dump() == {"fixed": 7.0}


def test_every_split_is_wanted(make_design: MakeDesign) -> None:
    design = make_design("dataset.splits={train: {meshes: {procedural: {count: 1}}}}")
    with pytest.raises(ConfigError, match=r"row none: dataset\.splits lacks validation and test"):
        design.cells()


def test_an_oracle_depends_on_data_and_generator_alone(make_design: MakeDesign) -> None:
    design = make_design(train={"scenes.pool": 2})
    oracles = {(cell.row, cell.recipe, cell.seed): cell.spec.oracle for cell in design.cells()}
    assert oracles["none", "default", 0] == oracles["none", "default", 1] == oracles["some", "default", 0]
    assert oracles["none", "default", 0] != oracles["fewer", "default", 0]  # other data
    assert oracles["none", "default", 0] != oracles["none", "thesis", 0]  # another generator
    assert oracles["none", "thesis", 0] == oracles["some", "thesis", 0]
    assert {oracle.train.steps for oracle in oracles.values()} == {1}
    other = make_design(name="other", train={"batch_size": 2})
    assert other.cell("none", "default", 0).spec.oracle == oracles["none", "default", 0]


def test_specifications_survive_json(make_design: MakeDesign) -> None:
    spec = make_design().cell("some", "thesis", 1).spec
    assert RunSpec.model_validate_json(spec.model_dump_json()) == spec
    assert validate(OracleSpec, spec.oracle.model_dump(mode="json"), "here") == spec.oracle


def test_the_files_that_a_run_needs() -> None:
    spec = Design.load("environment", "gpu").cell("disjoint", "default", 0).spec
    for wanted in (
        "cars/kenney_suv.glb",
        "cars/kaykit_sedan.glb",
        "envmaps/pmndrs_park.hdr",
        "envmaps/pmndrs_night.hdr",
    ):
        assert wanted in spec.files
    assert Design.load("environment", "cpu").cell("disjoint", "default", 0).spec.files == []


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
def test_a_mistake_in_a_file_is_one_line(make_design: MakeDesign, changes: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        make_design(**changes).cells()
    assert len(str(caught.value).splitlines()) == 1


def test_a_mistake_on_the_command_line_is_one_line(make_design: MakeDesign) -> None:
    with pytest.raises(ConfigError, match=r"'steps=3' changes nothing here; keys begin with 'dataset\.' or 'train\.'"):
        make_design("steps=3")
    cells = make_design().cells()
    with pytest.raises(ConfigError, match=r"no run matches 'noise/nonne'; did you mean 'noise/none'\?"):
        choose(cells, ["noise/nonne"])
    with pytest.raises(ConfigError, match=r"no run matches 'x/y/z'; there are noise/none, noise/some, noise/fewer\."):
        choose(cells, ["x/y/z"])


def test_a_file_of_ones_own_is_named_by_its_stem(make_design: MakeDesign, tmp_path: Path) -> None:
    assert make_design().name == "noise"
    assert yaml.safe_load((tmp_path / "noise.yaml").read_text())["title"] == "Noise"
