"""`svbrdfgan weather` and `texture` on files as artists make them: the scene comes back, weathered."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result
from PIL import Image

from svbrdfgan.cli import main
from svbrdfgan.io.gltf.accessors import append_accessor
from svbrdfgan.io.gltf.document import Document, read_document, write_document
from svbrdfgan.io.gltf.surface_files import mesh_document
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle

QUICK = ("--size", 64, "--resolution", 32)


@pytest.fixture(scope="module")
def car(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A van with what only a whole document keeps."""
    path = tmp_path_factory.mktemp("car") / "car.glb"
    document = mesh_document(path, build_vehicle(sample_vehicle("van", 5)))
    document.header["asset"] |= {"copyright": "somebody", "extras": {"title": "van"}}
    document.header["nodes"][0] |= {"name": "root", "extras": {"id": 7}}
    for material in document.table("materials"):
        material.pop("extras", None)  # that mark the parts as without gloss
    document.add("cameras", {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}})
    write_document(path, document)
    return path


def run(*words: object) -> Result:
    return CliRunner().invoke(main, [*map(str, words)])


def written(result: Result, path: Path) -> Document:
    assert result.exit_code == 0, result.output
    assert str(path) in result.stdout.splitlines()
    return read_document(path)


def test_the_scene_comes_back(car: Path, tmp_path: Path) -> None:
    result = run("weather", car, "--recipe", "rust", *QUICK, "-o", tmp_path / "a.glb")
    before, after = read_document(car).header, written(result, tmp_path / "a.glb").header
    assert after["asset"]["copyright"] == "somebody"
    assert after["asset"]["extras"]["title"] == "van"
    assert after["asset"]["extras"]["svbrdfgan"]["recipe"] == "rust"
    for name in ("nodes", "cameras", "scenes"):
        assert after[name] == before[name]
    assert [entry["name"] for entry in after["materials"]] == [entry["name"] for entry in before["materials"]]
    glass, body = (next(e for e in after["materials"] if e["name"] == name) for name in ("glass", "body"))
    assert glass == next(entry for entry in before["materials"] if entry["name"] == "glass")
    assert "baseColorTexture" in body["pbrMetallicRoughness"]
    assert re.search("^weathers: body", result.stderr, re.MULTILINE)
    np.testing.assert_allclose(load_mesh(tmp_path / "a.glb").bounds, load_mesh(car).bounds, atol=1e-6)


def test_programs_read_what_was_written(car: Path, tmp_path: Path) -> None:
    """One document on stdout; of a mesh that fails the reason, and exit code 1."""
    result = run("weather", car, tmp_path / "absent.glb", *QUICK, "--json", "-o", tmp_path / "out")
    assert result.exit_code == 1
    first, second = json.loads(result.stdout)
    assert first == {"mesh": str(car), "written": [str(tmp_path / "out" / "car.glb")], "error": None}
    assert second.keys() == first.keys()
    assert (second["mesh"], second["written"]) == (str(tmp_path / "absent.glb"), [])
    assert second["error"] in result.stderr


def test_the_maps_of_what_weathers_in_a_folder(car: Path, tmp_path: Path) -> None:
    words = (*QUICK, "--recipe", "rust", "--maps", tmp_path / "maps", "-o", tmp_path / "a.glb")
    written(run("weather", car, *words), tmp_path / "a.glb")
    with Image.open(tmp_path / "maps" / "body.base_color.png") as picture:
        assert picture.size == (64, 64)
        assert np.asarray(picture).std() > 1
    names = {path.name for path in (tmp_path / "maps").iterdir()}
    assert {"body.metallic_roughness.png", "body.normal.png"} <= names
    assert not any(name.startswith("glass") for name in names)


def test_base_colour_alone(car: Path, tmp_path: Path) -> None:
    words = ("weather", car, "--base-color-only", *QUICK, "-o", tmp_path / "a.glb")
    body = next(e for e in written(run(*words), tmp_path / "a.glb").table("materials") if e["name"] == "body")
    assert "metallicRoughnessTexture" not in body["pbrMetallicRoughness"]
    assert "normalTexture" not in body


def test_an_earlier_result_is_only_overwritten_by_force(car: Path, tmp_path: Path) -> None:
    words = ("weather", car, *QUICK, "-o", tmp_path / "a.glb")
    written(run(*words), tmp_path / "a.glb")
    again = run(*words)
    assert again.exit_code == 1
    assert "a.glb is there already; --force overwrites it." in again.stderr
    assert run(*words, "--force").exit_code == 0


def test_nothing_that_weathers_is_a_warning(car: Path, tmp_path: Path) -> None:
    result = run("weather", car, "--keep", "*", *QUICK, "-o", tmp_path / "a.glb")
    assert written(result, tmp_path / "a.glb").header == read_document(car).header
    assert "warning: nothing of car.glb weathers" in result.stderr


def test_of_several_meshes_each_fails_alone(car: Path, tmp_path: Path) -> None:
    (tmp_path / "broken.glb").write_text("this is no mesh")
    out = tmp_path / "out"
    result = run("weather", tmp_path / "broken.glb", car, *QUICK, "-o", out)
    assert result.exit_code == 1
    assert result.stdout.splitlines() == [str(out / "car.glb")]
    assert "broken.glb" in result.stderr
    assert "1 of 2 meshes could not be weathered" in result.stderr
    assert [path.name for path in out.iterdir()] == ["car.glb"]
    twice = run("weather", car, car, *QUICK, "-o", tmp_path / "twice")
    assert "two meshes would be written to" in twice.stderr


def test_gltf_and_obj(car: Path, tmp_path: Path) -> None:
    words = ("weather", car, *QUICK, "-o", tmp_path / "a.gltf")
    assert written(run(*words), tmp_path / "a.gltf").table("images")
    obj = tmp_path / "square.obj"
    obj.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n")
    result = run("weather", obj, "--front", "+Z", "--up", "+Y", *QUICK, "-o", tmp_path / "square.glb")
    assert written(result, tmp_path / "square.glb").table("textures")


def test_the_picture_is_of_the_written_file(
    car: Path, quick_renderer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("svbrdfgan.inference.studio._PICTURE", (48, 36))
    look = ("--renderer", "warp", "--picture")
    shown = []
    for amount in (0, 1):
        path = tmp_path / f"{amount}.png"
        words = ("weather", car, "--recipe", "rust", "--amount", amount, *QUICK, "-o", tmp_path / f"{amount}.glb")
        written(run(*words, *look, path), tmp_path / f"{amount}.glb")
        with Image.open(path) as picture:
            assert picture.size == (48, 36)
            shown.append(np.asarray(picture).astype(int))
    assert abs(shown[0] - shown[1]).mean() > 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--map", "roughness=0.2"), "--embedding and --map need --embedding-uvs"),
        (("--embedding-uvs", "--size", "64"), "--size and --embedding-uvs exclude each other"),
        (("--embedding-uvs", "--mask", "_DIRT"), "--mask and --embedding-uvs exclude each other"),
        (("--overlay", "layer", "--variants"), "--overlay and --variants exclude each other"),
        (("--front", "sideways"), "front is 'sideways'; wanted one of +X"),
        (("--front", "+Y", "--up", "-Y"), "lie along one axis"),
    ],
)
def test_what_cannot_be_is_told(words: tuple[str, ...], said: str, car: Path, tmp_path: Path) -> None:
    result = run("weather", car, *words, "-o", tmp_path / "a.glb")
    assert result.exit_code != 0
    assert said in result.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_mask_says_where_the_layer_may_lie(car: Path, tmp_path: Path) -> None:
    document = read_document(car)
    for mesh in document.table("meshes"):
        for primitive in mesh["primitives"]:
            count = document.table("accessors")[primitive["attributes"]["POSITION"]]["count"]
            name = document.table("materials")[primitive["material"]]["name"]
            values = np.full(count, name == "glass", "<f4")
            primitive["attributes"]["_WEAR"] = append_accessor(document, values)
    write_document(tmp_path / "car.glb", document)
    words = ("weather", tmp_path / "car.glb", "--mask", "_WEAR", "--recipe", "dust", *QUICK)
    result = run(*words, "-o", tmp_path / "a.glb")
    before, after = document.table("materials"), written(result, tmp_path / "a.glb").table("materials")
    assert [old["name"] for old, new in zip(before, after, strict=True) if old != new] == ["glass"]
    assert "weathers: glass;" in result.stderr
    refused = run(*words, "--embedding-uvs", "-o", tmp_path / "b.glb")
    assert "--mask and --embedding-uvs exclude each other" in refused.stderr


def test_an_overlay_leaves_the_scene_s_materials_alone(car: Path, tmp_path: Path) -> None:
    pytest.importorskip("xatlas")
    words = ("weather", car, "--recipe", "rust", "--size", 256, "--resolution", 64, "--overlay", tmp_path / "layer")
    result = run(*words, "-o", tmp_path / "a.glb")
    before, after = read_document(car), written(result, tmp_path / "a.glb")
    for name in ("materials", "nodes", "cameras", "scenes"):
        assert after.table(name) == before.table(name)
    size = {"base_color": 4, "orm": 3, "normal": 3}
    for name, channels in size.items():
        with Image.open(tmp_path / "layer" / f"layer.{name}.png") as picture:
            assert np.asarray(picture).shape[2] == channels
            assert np.asarray(picture).std() > 1
        assert str(tmp_path / "layer" / f"layer.{name}.png") in result.stdout.splitlines()
    refused = run(*words, "--maps", tmp_path / "maps", "-o", tmp_path / "b.glb")
    assert "--overlay and --maps exclude each other" in refused.stderr
    assert "--overlay is of one MESH" in run(*words[:1], car, *words[1:], "-o", tmp_path / "b").stderr


def test_both_states_as_variants(car: Path, tmp_path: Path) -> None:
    document = written(run("weather", car, "--variants", *QUICK, "-o", tmp_path / "a.glb"), tmp_path / "a.glb")
    assert [each["name"] for each in document.header["extensions"]["KHR_materials_variants"]["variants"]] == [
        "clean",
        "weathered",
    ]
    assert all(material in document.table("materials") for material in read_document(car).table("materials"))


def test_more_triangles_than_memory_holds_are_refused_before_they_are_read(car: Path, tmp_path: Path) -> None:
    document = read_document(car)
    document.header["nodes"] += [{"mesh": 0} for _ in range(5000)]
    document.header["scenes"][0]["nodes"] += list(
        range(len(document.header["nodes"]) - 5000, len(document.header["nodes"]))
    )
    write_document(tmp_path / "many.glb", document)
    result = run("weather", tmp_path / "many.glb", *QUICK, "--memory", 1, "-o", tmp_path / "a.glb")
    assert result.exit_code == 1
    assert re.search(
        r"many.glb shows [\d,]+ triangles, which need about [\d.]+ GiB of memory and 1.0 GiB", result.stderr
    )
    assert not (tmp_path / "a.glb").exists()


def test_a_name_with_half_a_character_comes_back(car: Path, tmp_path: Path) -> None:
    document = read_document(car)
    document.header["nodes"][0]["name"] = "half \ud800"
    write_document(tmp_path / "half.glb", document)
    words = ("weather", tmp_path / "half.glb", *QUICK, "-o", tmp_path / "a.glb")
    assert written(run(*words), tmp_path / "a.glb").header["nodes"][0]["name"] == "half \ud800"
