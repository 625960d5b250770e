"""`svbrdfgan texture` with random fields and conditions: files of each draw, and the sentence where there are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner, Result
from PIL import Image

from svbrdfgan.cli import main
from svbrdfgan.config.choices import PluginChoice
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import read_document, write_document
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.image import load_image
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle

NO_GPU = pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("car") / "car.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return path


def texture(*words: object) -> Result:
    return CliRunner().invoke(main, ["texture", *map(str, words)])


def test_the_same_command_writes_the_same_bytes(car: Path, varied_run: Path, tmp_path: Path) -> None:
    asked = ("--seed", 7, "--amount", 0.4, "--recipe", "rust", "--size", 64)
    for name in ("one", "other"):
        assert texture(car, "--model", varied_run, *asked, "-o", tmp_path / f"{name}.glb").exit_code == 0
    assert (tmp_path / "one.glb").read_bytes() == (tmp_path / "other.glb").read_bytes()


def test_a_finer_layer_and_finer_base_colours(car: Path, varied_run: Path, tmp_path: Path) -> None:
    asked = ("--model", varied_run, "--recipe", "rust", "--resolution", 64, "--embedding-uvs")
    result = texture(car, *asked, "-o", tmp_path / "fine.glb")
    assert result.exit_code == 0, result.output
    assert load_image(tmp_path / "fine.layer.png").flip(0).shape[:2] == (64, 64)
    sizes = {part.texture.shape for part in load_mesh(tmp_path / "fine.glb").parts if part.texture is not None}
    assert sizes == {(64, 64, 3)}


def test_many_draws_into_a_folder(car: Path, varied_run: Path, tmp_path: Path) -> None:
    asked = ("--model", varied_run, "--recipe", "dust", "--amount", 0.9, "--size", 64)
    result = texture(car, *asked, "--seed", 3, "--count", 2, "-o", tmp_path / "many")
    assert result.exit_code == 0, result.output
    names = [f"car-{seed}.glb" for seed in (3, 4)]
    assert result.stdout.splitlines() == [str(tmp_path / "many" / name) for name in names]
    scenes = [(tmp_path / "many" / name).read_bytes() for name in names]
    assert scenes[0] != scenes[1]
    assert texture(car, *asked, "--seed", 4, "-o", tmp_path / "alone.glb").exit_code == 0
    assert (tmp_path / "alone.glb").read_bytes() == (tmp_path / "many" / "car-4.glb").read_bytes()


def test_a_sheet_of_draws_amounts_and_recipes(
    car: Path, varied_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.report.sheet._RENDERED", (48, 30))
    words = ("--recipe", "rust", "--sheet", tmp_path / "sheet.png", "--renderer", "warp", "--size", 64)
    result = texture(car, "--model", varied_run, *words, "-o", tmp_path / "a.glb")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines()[-1] == str(tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (6 * 328 + 8, 3 * 272 + 8)
        cells = [sheet.crop((8 + 328 * column, 44, 328 * column + 328, 244)).tobytes() for column in range(6)]
    assert len(set(cells)) == 6


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("--recipe", "rust", "--amount", 2), "amount 2 is not allowed; wanted a number from 0 to 1."),
        (("--recipe", "rust", "--seed", -1), "seed -1 is not allowed; wanted a whole number from 0"),
        (("--recipe", "snow"), "does not know the recipe 'snow'. It knows rust, dust."),
        (("--recipe", "rust", "--resolution", 100), "resolution 100 is not allowed; the model was trained at 32"),
        ((), "knows the recipes rust, dust: name the one that is wanted."),
        pytest.param(("--recipe", "rust", "--device", "cuda"), "torch sees no CUDA GPU here", marks=NO_GPU),
    ],
)
def test_what_cannot_be_painted_is_told(
    asked: tuple[object, ...], said: str, car: Path, varied_run: Path, tmp_path: Path
) -> None:
    result = texture(car, "--model", varied_run, *asked, "-o", tmp_path / "a.glb")
    assert result.exit_code == 1
    (line,) = [line for line in result.stderr.strip().splitlines() if not line.startswith("  ")]  # but progress
    assert line.startswith("Error: ")
    assert said in line
    assert list(tmp_path.iterdir()) == []


def test_a_picture_is_of_one_layer(car: Path, varied_run: Path, tmp_path: Path) -> None:
    asked = ("--count", 2, "--picture", tmp_path / "a.png")
    result = texture(car, "--model", varied_run, *asked, "-o", tmp_path / "many")
    assert result.exit_code == 2
    assert "--picture is of one layer; leave out --count." in result.stderr


def test_without_a_fast_renderer_the_extra_is_named(
    car: Path, varied_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.plugins.select.select_renderer", lambda *_, **__: PluginChoice(name="numpy"))
    asked = ("--model", varied_run, "--recipe", "rust", "--picture", tmp_path / "a.png")
    result = texture(car, *asked, "-o", tmp_path / "a.glb")
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert "pip install 'svbrdfgan[mitsuba]'" in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_layer_beside_the_scene_within_a_mask(car: Path, varied_run: Path, tmp_path: Path) -> None:
    document = read_document(car)
    for mesh in document.table("meshes"):
        for primitive in mesh["primitives"]:
            count = document.table("accessors")[primitive["attributes"]["POSITION"]]["count"]
            primitive["attributes"]["_DIRT"] = append_accessor(document, np.full((count, 1), 0.5, "<f4"))
    write_document(tmp_path / "masked.glb", document)
    asked = ("--model", varied_run, "--recipe", "rust", "--size", 64, "--overlay")
    alphas = []
    for name, words in (("all", (car,)), ("half", (tmp_path / "masked.glb", "--mask", "_DIRT", "--keep", "glass"))):
        result = texture(*words, *asked, tmp_path / name, "-o", tmp_path / f"{name}.glb")
        assert result.exit_code == 0, result.output
        assert str(tmp_path / name / "layer.base_color.png") in result.stdout.splitlines()
        with Image.open(tmp_path / name / "layer.base_color.png") as layer:
            alphas.append(np.asarray(layer)[..., 3].max())
        scene = read_document(tmp_path / f"{name}.glb")
        assert scene.header["materials"] == document.header["materials"]
        assert scene.header["asset"]["extras"]["svbrdfgan"]["recipe"] == "rust"
    assert alphas[1] <= 128 < alphas[0]


def test_without_a_model_the_shipped_one_paints_and_that_is_told(
    car: Path, shipped: Path, varied_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.cli.texture.DEFAULT", "dust")
    told = "painting dust; --recipe and --model choose another (see `svbrdfgan models`)"
    found = {}
    for name, asked in {"none": (), "recipe": ("--recipe", "dust"), "model": ("--model", "corroded")}.items():
        needed = ("--recipe", "dust") if name == "model" else ()
        result = texture(car, *asked, *needed, "--size", 64, "-o", tmp_path / f"{name}.glb")
        assert result.exit_code == 0, result.output
        assert (told in result.stderr) == (name == "none")
        found[name] = (tmp_path / f"{name}.glb").read_bytes()
    assert found["none"] == found["recipe"] == found["model"]
    extras = read_document(tmp_path / "none.glb").header["asset"]["extras"]["svbrdfgan"]
    assert (extras["model"], extras["recipe"]) == ("corroded", "dust")


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (("--recipe", "dsut"), "no shipped model learned the recipe 'dsut'; did you mean 'dust'?"),
        (("--model", "corrode"), "no model of that name is shipped; did you mean 'corroded'? Shipped are corroded."),
    ],
)
def test_an_unknown_model_is_told(asked: tuple[str, ...], said: str, car: Path, shipped: Path, tmp_path: Path) -> None:
    result = texture(car, *asked, "-o", tmp_path / "a.glb")
    assert result.exit_code == 1
    assert said in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_amount_0_changes_no_byte_and_little_is_faint(car: Path, varied_run: Path, tmp_path: Path) -> None:
    asked = ("--model", varied_run, "--recipe", "rust", "--size", 64, "--overlay", tmp_path / "layer")
    result = texture(car, "--model", varied_run, "--recipe", "rust", "--amount", 0, "-o", tmp_path / "clean.glb")
    assert result.exit_code == 0, result.output
    before, after = read_document(car), read_document(tmp_path / "clean.glb")
    assert (after.header["materials"], after.header.get("images")) == (before.header["materials"], None)
    alphas = []
    for amount in (0, 0.001, 0.02, 0.05):
        result = texture(car, *asked, "--amount", amount, "-o", tmp_path / "a.glb", "--force")
        assert result.exit_code == 0, result.output
        with Image.open(tmp_path / "layer" / "layer.base_color.png") as layer:
            alphas.append(float(np.asarray(layer)[..., 3].mean()))
    assert alphas[0] == 0.0
    assert alphas[0] < alphas[1] < 0.05 * alphas[3]
    assert alphas[2] == pytest.approx(0.4 * alphas[3], rel=0.1)


def test_more_layers_than_a_folder_should_hold_are_refused_at_once(car: Path, tmp_path: Path) -> None:
    result = texture(car, "--count", 10**20, "-o", tmp_path / "many")
    assert result.exit_code == 2
    assert "1<=x<=10000" in result.stderr


def test_a_sheet_that_cannot_be_written_is_told_before_anything_is_made(car: Path, tmp_path: Path) -> None:
    (tmp_path / "sheet.png").mkdir()
    result = texture(car, "--sheet", tmp_path / "sheet.png", "-o", tmp_path / "a.glb")
    assert result.exit_code != 0
    assert "sheet.png' is a directory" in result.stderr
    (tmp_path / "file").touch()
    result = texture(car, "--sheet", tmp_path / "file" / "sheet.png", "-o", tmp_path / "a.glb")
    assert "sheet.png cannot be written" in result.stderr
    assert not (tmp_path / "a.glb").exists()
