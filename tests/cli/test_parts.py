"""`svbrdfgan parts`: a table, JSON and a picture of the same verdicts, and warnings on stderr."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from svbrdfgan.cli import main
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("car") / "car.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return path


def parts(*words: object) -> Result:
    return CliRunner().invoke(main, ["parts", *map(str, words)])


def test_the_table_says_verdict_and_reason(car: Path) -> None:
    result = parts(car)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0].startswith("car.glb: ")
    (glass,) = [line for line in lines if line.startswith("glass ")]
    assert "kept" in glass
    assert "blended, mean alpha 0.70" in glass
    assert any(line.startswith("body ") and "weathers" in line for line in lines)


def test_json_is_the_verdicts(car: Path) -> None:
    found = json.loads(parts(car, "--json", "--learnable", "gl*", "--keep", "body").stdout)
    weathers = {entry["name"]: entry["weathers"] for entry in found["parts"]}
    assert weathers["glass"]
    assert not weathers["body"]
    assert set(found["parts"][0]) == {"piece", "name", "weathers", "kind", "reason", "area", "sure"}
    assert "is kept" in found["warnings"][0]


def test_nose_and_roof_are_told_and_can_be_given(car: Path) -> None:
    found = parts(car, "--json", "--front", "x")
    assert json.loads(found.stdout)["orientation"]["front"] == "+X"
    assert "the nose is at +X and the roof at +Y" in found.stderr
    refused = parts(car, "--front", "up")
    assert refused.exit_code != 0


def test_the_picture_changes_with_the_verdicts(car: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svbrdfgan.report.part_views._SIZE", (200, 120))
    pictures = []
    for words in ((), ("--keep", "body")):
        result = parts(car, *words, "--picture", tmp_path / "parts.png")
        assert result.exit_code == 0, result.output
        assert result.stdout.splitlines()[-1] == str(tmp_path / "parts.png")
        with Image.open(tmp_path / "parts.png") as image:
            pictures.append(np.asarray(image.convert("RGB")).astype(int)[16:136])
    orange = [((picture[..., 0] - picture[..., 2]) > 60).mean() for picture in pictures]
    assert orange[0] > 0.1
    assert orange[1] < 0.5 * orange[0]


def test_other_kinds_of_picture_are_refused_before_anything_is_read(tmp_path: Path) -> None:
    result = parts(tmp_path / "missing.glb", "--picture", "parts.exr")
    assert result.exit_code == 2
    assert "wanted a .png or .jpg file" in result.stderr


def test_masks_are_told(car: Path) -> None:
    refused = parts(car, "--mask", "_WEAR")
    assert refused.exit_code == 1
    assert "no part has the vertex attribute _WEAR" in refused.stderr
