"""Errors in a manifest or in its files: all are reported at once, one sentence each, and nothing is written."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from svbrdfgan.data.photos.build import import_pictures
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.errors import ConfigError
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle

Data = dict[str, Any]
CAMERA: Data = {"azimuth_degrees": 40, "elevation_degrees": 15, "distance": 2.2, "target": [0, 0.2, 0]}


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mesh, a picture and a mask of the wrong size. Not to be changed."""
    folder = tmp_path_factory.mktemp("base")
    save_mesh_glb(folder / "car.glb", build_vehicle(sample_vehicle("van", 5)))
    (folder / "other").mkdir()
    save_mesh_glb(folder / "other" / "car.glb", build_vehicle(sample_vehicle("sedan", 5)))
    Image.new("RGB", (96, 64), (90, 80, 70)).save(folder / "car.png")
    Image.new("L", (64, 64), 255).save(folder / "square.png")
    corner = np.zeros((64, 96), dtype=np.uint8)
    corner[:6, :6] = 255
    Image.fromarray(corner).save(folder / "corner.png")
    return folder


def pictures(*changes: Data) -> Data:
    entry = {"file": "car.png", "mesh": "car.glb", "camera": CAMERA}
    return {"image": [16, 16], "texture": 16, "pictures": [{**entry, **change} for change in changes]}


def errors(data: Data, base: Path, folder: Path) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        import_pictures(read_manifest(data, "m.yaml"), folder, base=base, source="m.yaml")
    return str(caught.value).splitlines()


def test_all_errors_are_reported_at_once_and_nothing_is_written(base: Path, tmp_path: Path) -> None:
    away = {"position": [0, 0.2, 3], "look_at": [0, 0.2, 6]}
    data = pictures(
        {"file": "none.jpg"},
        {"mask": "square.png"},
        {"mask": "corner.png"},
        {"mesh": "none.glb"},
        {"camera": away},
        {"environment": "none.hdr"},
    )
    data |= {"environments": {"files": ["*.hdr"]}, "embedding": "hemispheric"}
    lines = errors(data, base, tmp_path / "own")
    wanted = (
        "mesh: .*none.glb does not exist",
        "environment: .*none.hdr does not exist",
        "embedding: .*hemispheric",
        r"environments: no file matches '\*.hdr'",
        r"pictures\[0\]: .*none.jpg does not exist",
        r"pictures\[1\]: .*a mask must have its picture's size",
        r"pictures\[2\]: car.png: the mask is not where the camera sees the mesh \(IoU 0.00\)",
        r"pictures\[4\]: car.png: the camera does not have all of the mesh in front of it",
    )
    assert len(lines) == len(wanted)
    for line, said in zip(lines, wanted, strict=True):
        assert re.match(f"m.yaml: {said}", line), line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (pictures({"mesh": "car.glb"}, {"mesh": "other/car.glb"}), "meshes: files share the names .'car'."),
        (pictures({}) | {"learnable": {"include": ["hood"]}}, "mesh: car.glb has no learnable part, only body, glass"),
        (
            pictures({"camera": {**CAMERA, "target": [0, 9, 0], "vertical_fov_degrees": 10}}),
            r"pictures\[0\]: car.png: the camera does not see the mesh",
        ),
        (pictures({"camera": {**CAMERA, "distance": 900}}), r"pictures\[0\]: car.png: the camera sees no pixel"),
    ],
)
def test_an_error_in_a_file_is_one_line(data: Data, said: str, base: Path, tmp_path: Path) -> None:
    (line,) = errors(data, base, tmp_path / "own")
    assert re.match(f"m.yaml: {said}", line), line


@pytest.mark.parametrize(
    ("data", "said"),
    [
        ({}, "there is no picture to train on"),
        (pictures({"environment_rotation_degrees": 9}), r"pictures\[0\]: environment_rotation_degrees turns the light"),
        ({"pictures": []}, "there is no picture to train on"),
        (pictures({"fil": "a"}), r"pictures\[0\]: unknown key 'fil'; did you mean 'file'"),
        (
            pictures({"camera": {**CAMERA, "azimuth": 3}}),
            r"camera: unknown key 'azimuth'; did you mean 'azimuth_degrees'",
        ),
        (pictures({"camera": {"position": [0, 0, 3]}}), r"pictures\[0\].camera: key 'look_at' is missing"),
        (pictures({"paint": [200, 0, 0]}), r"pictures\[0\].paint\[0\]: 200 is not allowed; .* at most 1"),
        (
            pictures({}) | {"paint": {"van.glb": [0, 0, 0]}},
            "paint names 'van.glb', which no picture shows; known are car.glb",
        ),
        (pictures({}) | {"test": ["car.glb"]}, "there is no picture to train on"),
        (pictures({"turntable": True}), r"pictures\[0\]: turntable says how a 'light_group' was taken, and none"),
        (
            pictures({"light_group": "yard", "environment": "sun.hdr"}),
            r"pictures\[0\]: light_group is for light that is estimated, and 'environment' names a known one",
        ),
        (pictures({"light_group": "yard"}) | {"light": "mean"}, "light_group is for light that is estimated"),
        (
            pictures({"light_group": "yard"}, {"light_group": "yard", "turntable": True}),
            "turntable is true in some pictures of light_group 'yard' and false in others",
        ),
    ],
)
def test_a_mistake_in_the_manifest_is_one_line(data: Data, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as caught:
        read_manifest(data, "m.yaml")
    (line,) = str(caught.value).splitlines()
    assert line.startswith("m.yaml: ")


def test_a_preview_is_overlays_alone_and_may_be_repeated(base: Path, tmp_path: Path) -> None:
    for count in (2, 1):
        manifest = read_manifest(pictures(*[{}] * count), "m.yaml")
        records = import_pictures(manifest, tmp_path / "own", base=base, preview=True)
        assert [one.exposure for one in records] == [None] * count
        assert [path.name for path in tmp_path.iterdir()] == ["own"]
        assert [path.name for path in (tmp_path / "own").iterdir()] == ["overlay"]
        names = sorted(path.name for path in (tmp_path / "own" / "overlay").iterdir())
        assert names == [*(f"{n:04d}.png" for n in range(count)), "contact-sheet.png"]


def test_the_overlay_is_the_picture_under_the_mesh_s_outline(base: Path, tmp_path: Path) -> None:
    import_pictures(read_manifest(pictures({}), "m.yaml"), tmp_path / "own", base=base, preview=True)
    with Image.open(tmp_path / "own" / "overlay" / "0000.png") as image:
        pixels = np.asarray(image)
    assert pixels.shape == (64, 96, 3)
    yellow = (pixels == (255, 220, 0)).all(axis=-1)
    rows, cols = np.nonzero(yellow)
    assert 80 < len(rows) < 600
    assert rows.min() > 5
    assert cols.max() < 90
    plain = pixels[~yellow & ~(pixels == (255, 120, 0)).all(axis=-1)]
    assert (plain == plain[0]).all()


def test_a_folder_in_use_is_not_changed(base: Path, tmp_path: Path) -> None:
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "thesis.txt").write_text("mine")
    (line,) = errors(pictures({}), base, tmp_path / "own")
    assert "holds more than overlays" in line
    assert (tmp_path / "own" / "thesis.txt").read_text() == "mine"


def test_doubts_are_reported(base: Path, tmp_path: Path) -> None:
    near = {**CAMERA, "distance": 1.0}
    manifest = read_manifest(pictures({"camera": near}, {"camera": {**CAMERA, "distance": 14}}), "m.yaml")
    records = import_pictures(manifest, tmp_path / "own", base=base, preview=True)
    assert "reaches beyond the picture" in records[0].doubts[0]
    assert "enlarged" in records[1].doubts[0]


def test_a_distance_in_another_unit_is_refused(base: Path, tmp_path: Path) -> None:
    data = {**pictures({"camera": {**CAMERA, "distance": 40.0}}), "image": [384, 256]}
    (line,) = errors(data, base, tmp_path / "own")
    assert "% of the picture" in line
    assert "distance" in line
    assert not (tmp_path / "own").exists()
