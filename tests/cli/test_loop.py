"""The eight commands of the loop on tiny inputs: what they write, and the one sentence where they cannot."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from click.testing import CliRunner, Result
from PIL import Image
from svbrdfgan_numpy import NumpyRenderer

from svbrdfgan.cli import main
from svbrdfgan.data.exemplar_files import load_picture
from svbrdfgan.io.environment import save_environment
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.protocols import RendererCapabilities
from svbrdfgan.weathering.recipes import RECIPES

Data = Callable[..., dict[str, Any]]


def invoke(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def succeeded(result: Result) -> str:
    assert result.exit_code == 0, result.output
    return result.stdout


def failed(result: Result, said: str) -> None:
    """Exit code 1, nothing on stdout, one sentence on stderr, no traceback."""
    assert result.exit_code == 1, result.output
    assert result.stdout == ""
    (line,) = [line for line in result.stderr.strip().splitlines() if not line.startswith("  ")]  # but progress
    assert line.startswith("Error: ")
    assert said in line


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("car") / "car.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, training_data: Data) -> Path:
    """A run of four steps. Not to be changed."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "train.yaml").write_text(json.dumps(training_data()))
    output = succeeded(invoke("train", folder / "train.yaml", "-o", folder / "run"))
    assert "4 steps" in output
    assert "validation recovered" in output
    return folder / "run"


def test_an_evaluation_that_needs_too_much_memory_is_refused(run: Path) -> None:
    failed(invoke("evaluate", run, "--no-oracle", "--memory", 0.1), "GiB of memory and 0.1 GiB are allowed")
    assert not (run / "evaluation.json").exists()


EMBEDDED = ("--embedding-uvs", "--force")


def assert_painted(path: Path, mesh: Path) -> None:
    """A GLB that another program opens, as large as the mesh, with a base colour texture that is not plain."""
    scene = trimesh.load(path)
    original = load_mesh(mesh)
    np.testing.assert_allclose(scene.bounds, original.bounds, atol=1e-4)
    textures = [
        geometry.visual.material.baseColorTexture
        for geometry in scene.geometry.values()
        if getattr(geometry.visual, "material", None) is not None
        and getattr(geometry.visual.material, "baseColorTexture", None) is not None
    ]
    assert textures
    assert any(np.asarray(texture.convert("RGB")).std() > 0 for texture in textures)
    with Image.open(path.with_suffix(".layer.png")) as layer:
        assert layer.mode == "RGBA"


def test_bake(car: Path, tmp_path: Path) -> None:
    output = succeeded(invoke("bake", car, "--resolution", 32, "--option", "resolution=32", "-o", tmp_path / "baked"))
    assert f"written to {tmp_path / 'baked'}" in output
    names = {path.name for path in (tmp_path / "baked").iterdir()}
    assert "metrics.json" in names
    assert {Path(name).suffix for name in names} >= {".exr", ".png", ".glb", ".json"}


def test_weather(car: Path, tmp_path: Path) -> None:
    succeeded(
        invoke(
            "weather", car, "--recipe", "rust", "--resolution", 32, "--seed", 3, *EMBEDDED, "-o", tmp_path / "rusty.glb"
        )
    )
    assert_painted(tmp_path / "rusty.glb", car)
    beside = {"rusty.layer.png", "rusty.roughness.png", "rusty.metallic.png", "rusty.normal.png"}
    assert {path.name for path in tmp_path.iterdir()} == {"rusty.glb", *beside}


def test_weather_of_base_colour_alone(car: Path, tmp_path: Path) -> None:
    words = ("weather", car, "--resolution", 32, "--base-color-only", *EMBEDDED, "-o", tmp_path / "dull.glb")
    succeeded(invoke(*words))
    assert_painted(tmp_path / "dull.glb", car)
    assert len(list(tmp_path.iterdir())) == 2
    both = invoke(*words, "--map", "roughness=0.2")
    assert both.exit_code == 2
    assert "--map and --base-color-only exclude each other" in both.stderr


def test_the_mesh_itself_is_not_written_over(car: Path, run: Path, tmp_path: Path) -> None:
    own = shutil.copy(car, tmp_path / "own.glb")
    before = own.read_bytes()
    for words in (("weather", own), ("texture", own, "--model", run)):
        failed(
            invoke(*words, "--resolution", 32, "-o", tmp_path / "." / "own.glb"),
            "own.glb is the input mesh, which the output would overwrite; choose another path.",
        )
    assert own.read_bytes() == before


def test_learnable_parts_are_printed_and_chosen(car: Path, tmp_path: Path) -> None:
    words = ("weather", car, "--resolution", 32, *EMBEDDED, "-o", tmp_path / "car.glb")
    plain, chosen = invoke(*words), invoke(*words, "--learnable", "Glass*")
    assert (plain.exit_code, chosen.exit_code) == (0, 0)
    carrying, clean = plain.stderr.strip().split("; left clean: ")
    assert carrying.startswith("layer on: body")
    assert "glass" in clean.split(", ")
    assert "layer on: glass; left clean: body" in chosen.stderr
    failed(invoke(*words, "--learnable", "bodies"), "Change 'learnable' (--learnable)")


def test_a_body_that_its_name_keeps_clean_is_reported(car: Path, tmp_path: Path) -> None:
    """Light blue paint is no light."""
    mesh = load_mesh(car)
    names = {"body": "LightBlue", "glass": "bumper"}
    blue = replace(mesh, parts=tuple(replace(part, name=names.get(part.name, part.name)) for part in mesh.parts))
    save_mesh_glb(tmp_path / "blue.glb", blue)
    words = ("weather", tmp_path / "blue.glb", "--resolution", 32, *EMBEDDED, "-o", tmp_path / "car.glb")
    plain, chosen = invoke(*words), invoke(*words, "--learnable", "LightBlue")
    assert re.search(r"warning: LightBlue is \d\d% of the surface and its name keeps it clean", plain.stderr)
    assert "warning" not in chosen.stderr


def test_weather_with_a_further_map(car: Path, tmp_path: Path) -> None:
    words = ("weather", car, "--recipe", "smooth-dirt", "--amount", 1, "--resolution", 32, *EMBEDDED)
    words = (*words, "-o", tmp_path / "dull.glb")
    succeeded(invoke(*words, "--map", "roughness=0.2"))
    with Image.open(tmp_path / "dull.layer.png") as layer, Image.open(tmp_path / "dull.roughness.png") as rough:
        alpha, values = np.asarray(layer)[..., 3], np.asarray(rough) / 255
    assert values.min() == pytest.approx(0.2, abs=0.01)
    assert values.max() > 0.8
    assert np.corrcoef(alpha.ravel(), values.ravel())[0, 1] > 0.99
    failed(
        invoke(*words, "--map", "roughness=2"), "--map: maps.roughness: 2 is not allowed; wanted a number of at most 1"
    )
    failed(invoke(*words, "--map", "metallic=0"), "--map: maps: metallic needs roughness")


def test_weather_by_no_amount_is_clear(car: Path, tmp_path: Path) -> None:
    succeeded(invoke("weather", car, "--amount", 0, "--resolution", 32, *EMBEDDED, "-o", tmp_path / "clean.glb"))
    with Image.open(tmp_path / "clean.layer.png") as layer:
        assert np.asarray(layer)[..., 3].max() == 0


def test_dataset_and_its_overrides(dataset_data: Data, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text(json.dumps(dataset_data()))
    words = ("dataset", tmp_path / "data.yaml", "splits.train.views=1", "spp=1", "--workers", 1, "-o", tmp_path / "out")
    output = succeeded(invoke(*words))
    assert output.splitlines() == [
        "train: 2 exemplars of 2 meshes",
        "validation: 2 exemplars of 1 meshes",
        "parts with a layer: body",
    ]
    assert json.loads((tmp_path / "out" / "train" / "000001.json").read_text())["spp"] == 1
    assert succeeded(invoke(*words)) == output
    failed(invoke(*words[:3], "spp=2", "-o", tmp_path / "out"), "holds a data set of another configuration")


@pytest.mark.parametrize(
    ("words", "last"), [(["-v"], "199"), ([], "part-004, part-005, part-006 and 193 more (-v lists all)")]
)
def test_dataset_sums_up_the_names_of_many_parts(
    words: list[str], last: str, dataset_data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "data.yaml").write_text(json.dumps(dataset_data()))
    names = tuple(f"part-{number:03d}" for number in range(200))
    meshes = {split: [SimpleNamespace(painted=names)] for split in ("train", "validation")}
    plan = SimpleNamespace(sampler=lambda split: [], meshes=meshes)
    monkeypatch.setattr("svbrdfgan.data.generate.generate", lambda *_, **__: plan)
    output = succeeded(invoke(*words, "dataset", tmp_path / "data.yaml", "-o", tmp_path / "out"))
    line = output.splitlines()[-1]
    assert line.startswith("parts with a layer: part-000, part-001, ")
    assert line.endswith(last)


def test_dry_run_writes_nothing(dataset_data: Data, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text(json.dumps(dataset_data()))
    output = succeeded(invoke("dataset", tmp_path / "data.yaml", "-o", tmp_path / "out", "--dry-run"))
    assert "exemplars: 8 of 3 meshes" in output
    assert all(word in output for word in ("time:", "disk:", "memory:"))
    assert not (tmp_path / "out").exists()


def test_what_is_no_use_together_is_refused(dataset_data: Data, tiny_dataset: Path, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text(json.dumps(dataset_data()))
    both = invoke("dataset", tmp_path / "data.yaml", "-o", tmp_path / "out", "--dry-run", "--preview")
    scene = tiny_dataset / "train" / "000000.json"
    alone = invoke("render", scene, "-o", tmp_path / "a.png", "--option", "max_bounces=2")
    assert (both.exit_code, alone.exit_code) == (2, 2)
    assert [path.name for path in tmp_path.iterdir()] == ["data.yaml"]


def test_preview_writes_one_picture(dataset_data: Data, tmp_path: Path) -> None:
    (tmp_path / "data.yaml").write_text(json.dumps(dataset_data()))
    output = succeeded(invoke("dataset", tmp_path / "data.yaml", "-o", tmp_path / "out", "--preview"))
    assert output.strip() == str(tmp_path / "out" / "preview.png")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["preview.png"]
    with Image.open(tmp_path / "out" / "preview.png") as picture:
        assert picture.size == (64, 32)


def test_train_is_resumed_and_refused(training_data: Data, run: Path, tmp_path: Path) -> None:
    config = run.parent / "train.yaml"
    failed(invoke("train", config, "-o", run), "holds a run already; give --resume")
    failed(invoke("train", config, "loss.r2=7", "-o", run, "--resume"), "train.loss.r2")
    output = succeeded(invoke("train", config, "-o", run, "--resume"))
    assert "4 steps" in output


def test_what_failed_before_it_began_can_be_corrected(training_data: Data, tmp_path: Path) -> None:
    (tmp_path / "train.yaml").write_text(json.dumps(training_data(steps=1)))
    words = ("train", tmp_path / "train.yaml", "-o", tmp_path / "run")
    refused = invoke(*words, "renderer={name: numpy, max_bounces: 2}")
    assert refused.exit_code == 1
    assert "set rendering: online or choose another renderer" in refused.stderr.splitlines()[-1]
    assert "1 steps" in succeeded(invoke(*words))


def test_evaluate(run: Path, tmp_path: Path) -> None:
    output = succeeded(invoke("evaluate", run, "--split", "validation", "--no-oracle", "--device", "cpu"))
    verdict = json.loads((run / "evaluation.validation.json").read_text())
    assert f"recovered: {verdict['generated']['recovered']:.3f}" in output
    assert verdict["oracle"] is None
    assert verdict["truth"]["flip"] < verdict["generated"]["flip"]
    report = Path(output.splitlines()[-1])
    assert report.suffix == ".html"
    assert report.is_file()


def test_evaluate_where_the_data_set_was_moved(
    run: Path, dataset_copy: Path, dataset_data: Data, tmp_path: Path
) -> None:
    elsewhere = shutil.copytree(run, tmp_path / "run")
    words = ("evaluate", elsewhere, "--split", "validation", "--no-oracle")
    config = json.loads((elsewhere / "config.json").read_text())
    (elsewhere / "config.json").write_text(json.dumps(config | {"dataset_folder": "gone"}))
    failed(invoke(*words), "the run's data set is no longer gone: say where it is, with --dataset")
    printed = succeeded(invoke(*words, "--dataset", dataset_copy, "--json"))
    assert json.loads(printed) == json.loads((elsewhere / "evaluation.validation.json").read_text())
    plan = json.loads((dataset_copy / "dataset.json").read_text())
    plan["config"]["spp"] += 1
    (dataset_copy / "dataset.json").write_text(json.dumps(plan))
    failed(invoke(*words, "--dataset", dataset_copy), "another configuration than the data set that the run learned")


def test_texture(run: Path, car: Path, tmp_path: Path) -> None:
    output = succeeded(invoke("texture", car, "--model", run, *EMBEDDED, "-o", tmp_path / "painted.glb"))
    assert output.splitlines() == [str(tmp_path / "painted.glb"), str(tmp_path / "painted.layer.png")]
    assert_painted(tmp_path / "painted.glb", car)


@pytest.fixture
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("svbrdfgan.inference.studio._PICTURE", (48, 36))


@pytest.mark.usefixtures("small_pictures")
def test_a_picture_beside_the_glb(car: Path, run: Path, quick_renderer: str, tmp_path: Path) -> None:
    look = ("--renderer", quick_renderer, "--picture")
    for words in (("weather", car, "--resolution", 32), ("texture", car, "--model", run)):
        output = succeeded(
            invoke(*words, "--size", 64, "--force", "-o", tmp_path / "car.glb", *look, tmp_path / f"{words[0]}.png")
        )
        assert output.splitlines()[-1] == str(tmp_path / f"{words[0]}.png")
        with Image.open(tmp_path / f"{words[0]}.png") as picture:
            assert picture.size == (48, 36)
            pixels = np.asarray(picture).astype(int)
        background = pixels[0].mean(axis=0)
        assert background.max() - background.min() < 8
        shown = (abs(pixels - background) > 40).any(axis=-1)
        border = np.concatenate([*shown[[0, -1]], *shown.T[[0, -1]]])
        assert border.mean() < 0.05  # of a ground of a few samples a pixel
        assert 0.1 < shown.mean() < 0.8


@pytest.mark.usefixtures("small_pictures")
def test_a_picture_by_another_light_and_with_roughness(car: Path, quick_glossy_renderer: str, tmp_path: Path) -> None:
    words = (
        "weather",
        car,
        "--resolution",
        32,
        *EMBEDDED,
        "-o",
        tmp_path / "car.glb",
        "--picture",
        tmp_path / "car.jpg",
    )
    red = torch.zeros(8, 16, 3)
    red[..., 0] = 1.0
    save_environment(tmp_path / "red.exr", red)
    own = ("--renderer", quick_glossy_renderer, "--map", "roughness=0.2", "--environment", tmp_path / "red.exr")
    succeeded(invoke(*words, *own))
    with Image.open(tmp_path / "car.jpg") as picture:
        pixels = np.asarray(picture).astype(int)
    assert (pixels[..., 0] - pixels[..., 1]).max() > 50
    save_environment(tmp_path / "black.exr", 0 * red)
    failed(
        invoke(*words, "--renderer", quick_glossy_renderer, "--environment", tmp_path / "black.exr"),
        "the environment is black",
    )


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--picture", "car.bmp"), "car.bmp: wanted a name that ends in .png or .jpg"),
        (("-o", "car.obj"), "car.obj: wanted a name that ends in .glb"),
        (("-o", "/dev/null/car.glb"), "/dev/null/car.glb cannot be written"),
        (("--environment", "sky.hdr"), "--environment and --renderer need --picture"),
        (("--picture", "car.png", "--renderer", "warpp"), "did you mean 'warp'"),
        (("--picture", "car.png", "--environment", "sky.hdr"), "sky.hdr does not exist"),
        (
            ("--picture", "car.png", "--renderer", "numpy"),
            "numpy renderer cannot render roughness",
        ),
    ],
)
def test_a_picture_that_cannot_be_is_refused_at_once(
    words: tuple[str, ...], said: str, car: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(NumpyRenderer, "capabilities", RendererCapabilities())
    result = invoke("weather", car, "-o", tmp_path / "car.glb", *words)
    assert result.exit_code != 0
    assert said in result.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("index", [0, 5])
def test_render_gives_back_the_exemplar(index: int, tiny_dataset: Path, tmp_path: Path) -> None:
    stem = tiny_dataset / "train" / f"{index:06d}"
    succeeded(invoke("render", stem.with_suffix(".json"), "-o", tmp_path / "again.exr"))
    assert torch.equal(load_picture(tmp_path / "again.exr"), load_picture(stem.with_suffix(".exr")))


def test_render_with_another_renderer_is_close(tiny_dataset: Path, tmp_path: Path) -> None:
    pytest.importorskip("warp", reason="the warp renderer needs warp-lang")
    scene = tiny_dataset / "train" / "000000.json"
    words = ("--renderer", "warp", "--option", "device=cpu", "--spp", 64)
    succeeded(invoke("render", scene, "-o", tmp_path / "warp.exr", *words))
    theirs, ours = (load_picture(p).float() for p in (tmp_path / "warp.exr", scene.with_suffix(".exr")))
    torch.testing.assert_close(theirs.mean(dim=(0, 1)), ours.mean(dim=(0, 1)), rtol=0.1, atol=0.01)


@pytest.mark.parametrize(("suffix", "mode"), [(".png", "RGBA"), (".jpg", "RGB")])
def test_render_for_the_eye(suffix: str, mode: str, tiny_dataset: Path, tmp_path: Path) -> None:
    succeeded(invoke("render", tiny_dataset / "train" / "000000.json", "-o", tmp_path / f"x{suffix}"))
    with Image.open(tmp_path / f"x{suffix}") as picture:
        assert (picture.mode, picture.size) == (mode, (32, 32))


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("bake", "none.glb"), "none.glb"),
        (("bake", "CAR", "--embedding", "sphericall"), "sphericall"),
        (("bake", "CAR", "--option", "resolutoin=32"), "did you mean 'resolution'"),
        (("bake", "CAR", "--option", "resolution"), "is not an override; wanted key=value"),
        (("weather", "none.glb"), "none.glb"),
        (("weather", "CAR", "--recipe", "rusty"), "rust"),
        (("weather", "CAR", "--resolution", "32", "--option", "amuont=1"), "amuont"),
        (("weather", "TEXT"), "broken.glb"),
        (("dataset", "none.yaml"), "none.yaml"),
        (("dataset", "DATA", "sppp=3"), "unknown key 'sppp'"),
        (("dataset", "DATA", "splits.train.meshes={files: [cars/*.glb]}"), "no file matches 'cars/*.glb'"),
        (("dataset", "DATA", "renderer=wrap"), "wrap"),
        (("dataset", "DATA", "embedding.resolutoin=3"), "resolutoin"),
        (("dataset", "DATA", "weathering={recipe: dsut}"), "dsut"),
        (("dataset", "DATA", "sppp=3", "--dry-run"), "unknown key 'sppp'"),
        (("train", "none.yaml"), "none.yaml"),
        (("train", "TRAIN", "stesp=3"), "unknown key 'stesp'"),
        (("train", "TRAIN", "dataset=nowhere"), "is not a data set"),
        (("texture", "CAR", "--model", "nowhere"), "nowhere is not a run"),
        (("render", "none.json"), "none.json"),
        (("render", "TEXT"), "not valid JSON"),
        (("render", "SCENE", "--renderer", "nump"), "nump"),
        (("render", "SCENE", "--assets", "elsewhere"), "is missing; the scene cannot be rendered"),
    ],
    ids=lambda value: " ".join(value[:4]) if isinstance(value, tuple) else None,
)
def test_a_failure_is_one_sentence_and_leaves_nothing(
    words: tuple[str, ...],
    said: str,
    car: Path,
    tmp_path: Path,
    tiny_dataset: Path,
    dataset_data: Data,
    training_data: Data,
) -> None:
    given = tmp_path / "given"
    given.mkdir()
    (given / "data.yaml").write_text(json.dumps(dataset_data()))
    (given / "train.yaml").write_text(json.dumps(training_data()))
    (given / "broken.glb").write_text("this is no mesh")
    names = {
        "CAR": car,
        "DATA": given / "data.yaml",
        "TRAIN": given / "train.yaml",
        "TEXT": given / "broken.glb",
        "SCENE": tiny_dataset / "train" / "000000.json",
    }
    suffix = {"weather": ".glb", "texture": ".glb", "render": ".exr"}.get(words[0], "")
    out = tmp_path / f"out{suffix}"
    failed(invoke(*(names.get(word, word) for word in words), "-o", out), said)
    assert not out.exists()
    assert [path.name for path in tmp_path.iterdir()] == ["given"]


def test_render_needs_a_known_suffix(tiny_dataset: Path, tmp_path: Path) -> None:
    failed(invoke("render", tiny_dataset / "train" / "000000.json", "-o", tmp_path / "x.bmpp"), "x.bmpp")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("command", ["weather", "texture"])
def test_what_is_not_a_glb_is_refused(command: str, car: Path, run: Path, tmp_path: Path) -> None:
    words = ("--model", run) if command == "texture" else ("--resolution", 32)
    failed(invoke(command, car, *words, "-o", tmp_path / "car.obj"), ".glb")
    assert list(tmp_path.iterdir()) == []


def test_evaluate_relights_with_files(run: Path, tmp_path: Path) -> None:
    words = ("evaluate", run, "--split", "validation", "--no-oracle", "--device", "cpu", "--relight")
    failed(invoke(*words, tmp_path / "*.hdr"), "no file matches")


def test_evaluate_tells_what_is_not_there(run: Path, tmp_path: Path) -> None:
    failed(invoke("evaluate", tmp_path), "is not a run")
    result = invoke("evaluate", run, "--split", "test", "--no-oracle", "--device", "cpu")
    assert result.exit_code == 1
    assert "has no split 'test'; it has train, validation" in result.stderr


@pytest.mark.slow
def test_demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "demo").mkdir()
    from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
    from svbrdfgan.experiments import demo

    for name, override in (("dataset.yaml", "splits.train.meshes.procedural.count=4"), ("train.yaml", "steps=20")):
        smaller = apply_overrides(load_yaml(Path(demo.__file__).parent / name), [override])
        (tmp_path / "demo" / name).write_text(json.dumps(smaller))
    output = succeeded(invoke("demo", "--out", tmp_path / "demo"))
    assert "recovered:" in output
    assert (tmp_path / "demo" / "weathered_vehicle.glb").is_file()


def test_the_help_of_weather_names_every_option_of_every_recipe() -> None:
    said = succeeded(invoke("weather", "--help"))
    listed = dict(re.findall(r"^ {4}([a-z-]+) {2,}((?:\w+, )*\w+)$", said, re.MULTILINE))
    told = {name: {*words.split(", "), *listed["all"].split(", ")} for name, words in listed.items() if name != "all"}
    named = ("amount", "seed")  # options of their own
    assert told == {
        name: {spec.name for spec in fields(kind) if spec.name not in named} for name, kind in RECIPES.items()
    }
