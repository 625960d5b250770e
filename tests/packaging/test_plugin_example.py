"""The plugin in `examples/plugin`, from its wheel: found by name, judged by the kit, and trained with."""

import json
import os
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

EXAMPLE = Path(__file__).parents[2] / "examples" / "plugin"
DATASET: dict[str, Any] = {
    "seed": 1,
    "image": [32, 32],
    "texture": 32,
    "spp": 8,
    "renderer": {"name": "grid", "density": 2.0},
    "embedding": {"name": "cube", "margin": 0.05},
    "environments": {"procedural": {"count": 2, "seed": 1}},
    "environment_rows": 16,
    "splits": {
        "train": {"meshes": {"procedural": {"count": 1, "seed": 1}}, "views": 4},
        "validation": {"meshes": {"procedural": {"count": 1, "seed": 2}}, "views": 2},
    },
}
TRAINING: dict[str, Any] = {
    "dataset": "dataset",
    "steps": 10,
    "batch_size": 2,
    "generator": {"width": 4, "blocks": 1},
    "discriminator": {"width": 4, "layers": 1},
    "renderer": "grid",
    "spp": 8,
    "score_every": 10,
    "save_every": 10,
    "device": "cpu",
}


@pytest.fixture
def svbrdfgan(site_with_example: Path, tmp_path: Path) -> Any:
    """The command, run where both wheels are installed beside the dependencies, without the sources."""
    path = [str(site_with_example), sysconfig.get_path("purelib"), sysconfig.get_path("platlib")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path), "OMP_NUM_THREADS": "1"}
    code = "import sys; from svbrdfgan.cli import main; main(sys.argv[1:])"

    def run(*words: str) -> str:
        command = [sys.executable, "-S", "-P", "-c", code, *words]
        done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    return run


def test_its_wheel_holds_its_package_alone(example_wheel: Path) -> None:
    project = tomllib.loads((EXAMPLE / "pyproject.toml").read_text())["project"]
    name = project["name"].replace("-", "_")
    tops = {file.split("/")[0] for file in zipfile.ZipFile(example_wheel).namelist()}
    assert tops == {name, f"{name}-{project['version']}.dist-info"}


@pytest.mark.full
@pytest.mark.parametrize(("listing", "name"), [("backends", "grid"), ("embeddings", "cube")])
def test_it_is_listed_as_working(svbrdfgan: Any, listing: str, name: str) -> None:
    (row,) = (row for row in json.loads(svbrdfgan(listing, "--json")) if row["name"] == name)
    assert (row["distribution"], row["status"]) == ("svbrdfgan-example", "ok")


@pytest.mark.full
@pytest.mark.parametrize("name", ["grid", "cube"])
def test_the_kit_passes_from_the_wheel(svbrdfgan: Any, name: str) -> None:
    """A quick group; `tests/conformance` runs all."""
    outcomes = json.loads(svbrdfgan("check", name, "--only", "contract.", "--json"))
    assert {o["status"] for o in outcomes} <= {"passed", "not declared"}
    assert len([o for o in outcomes if o["status"] == "passed"]) >= len(outcomes) / 2


@pytest.mark.full
def test_ten_steps_of_training_with_both(svbrdfgan: Any, tmp_path: Path) -> None:
    for name, data in {"dataset": DATASET, "train": TRAINING}.items():
        (tmp_path / f"{name}.yaml").write_text(json.dumps(data))
    svbrdfgan("dataset", "dataset.yaml", "-o", "dataset")
    scene = json.loads(next((tmp_path / "dataset" / "train").glob("*.json")).read_text())
    assert scene["embedding"] == {"name": "cube", "options": {"margin": 0.05}}
    told = svbrdfgan("train", "train.yaml", "-o", "run")
    assert "10 steps" in told
    assert "validation recovered" in told
