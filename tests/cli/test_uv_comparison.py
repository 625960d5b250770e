"""`svbrdfgan embeddings --compare`, and the summary that `svbrdfgan bake` writes."""

import json
import re
from pathlib import Path

import pytest
import trimesh
from click.testing import CliRunner
from PIL import Image

from svbrdfgan.cli import main


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two boxes, and a plane that has no height."""
    for name, extents in {"low": (1, 0.5, 2), "high": (1, 1.5, 2)}.items():
        trimesh.creation.box(extents).export(tmp_path / f"{name}.obj")
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 0, -1]], [[0, 1, 2]]).export(tmp_path / "plane.obj")
    return tmp_path


@pytest.mark.full
def test_the_table(folder: Path) -> None:
    words = ["embeddings", "--compare", str(folder), "--embedding", "hemispherical", "--resolution", "64"]
    result = CliRunner(env={"COLUMNS": "120"}).invoke(main, words)
    assert result.exit_code == 0, result.output
    rows = dict(re.split(r"\s{2,}", line, maxsplit=1) for line in result.stdout.splitlines() if "  " in line)
    assert rows["meshes that failed"] == "1 of 3"
    assert float(rows["L2 stretch"].split(" / ")[0]) > 1.0
    assert "hemispherical: plane.obj: the mesh is flat" in result.stdout
    assert "pairs of meshes measured: 1" in result.stdout


def test_json(folder: Path) -> None:
    words = ["embeddings", "--compare", str(folder), "--embedding", "hemispherical", "--resolution", "64", "--json"]
    result = CliRunner().invoke(main, words)
    data = json.loads(result.stdout)["hemispherical"]
    assert set(data) == {"summary", "failures", "meshes", "similarity"}
    assert set(data["meshes"]) == {"low.obj", "high.obj"}
    assert data["summary"]["similarity"]["of"] == "high.obj / low.obj"


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        (["--embedding", "hemispherical"], "--embedding goes with --compare"),
        (["--compare", "nowhere"], "holds no mesh"),
        (["--compare", ".", "--embedding", "hemispheric"], "holds no mesh"),
    ],
)
def test_mistakes_are_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: list[str], wanted: str) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["embeddings", *words])
    assert result.exit_code != 0
    assert wanted in result.output


@pytest.mark.full
def test_one_embedding_with_two_options(folder: Path) -> None:
    names = ["hemispherical", "hemispherical,centre_height=-1,resolution=64"]
    words = [word for name in names for word in ("--embedding", name)]
    result = CliRunner().invoke(main, ["embeddings", "--compare", str(folder), *words, "--json"])
    one, other = (json.loads(result.stdout)[name]["meshes"]["low.obj"] for name in names)
    assert one["area_mean"] != other["area_mean"]


def test_an_unknown_embedding_is_reported(folder: Path) -> None:
    result = CliRunner().invoke(main, ["embeddings", "--compare", str(folder), "--embedding", "hemispheric"])
    assert result.exit_code != 0
    assert "did you mean 'hemispherical'" in result.output


@pytest.mark.full
def test_bake_writes_the_card(folder: Path, tmp_path: Path) -> None:
    words = ["bake", str(folder / "low.obj"), "--resolution", "32", "-o", str(tmp_path / "baked")]
    result = CliRunner().invoke(main, words)
    assert result.exit_code == 0, result.output
    summary = json.loads((tmp_path / "baked" / "card.json").read_text())
    assert summary["seam_length"] == 0.0
    assert f"stretch_l2: {summary['stretch_l2']:.4g}" in result.stdout
    with Image.open(tmp_path / "baked" / "card.png") as picture:
        assert picture.format == "PNG"
