"""Staged photographs: what a photographer has, the truth beside it, and a Blender that may fail in between."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import yaml
from click.testing import CliRunner
from PIL import Image

from svbrdfgan.cli import main
from svbrdfgan.data.index import Dataset
from svbrdfgan.data.photos.build import import_pictures
from svbrdfgan.data.photos.manifest import read_manifest
from svbrdfgan.data.staged_photos.config import StagedPhotosConfig, staged_photos_config
from svbrdfgan.data.staged_photos.cycles import find_blender
from svbrdfgan.data.staged_photos.stage import StagedPhoto, stage_photos
from svbrdfgan.errors import AssetError, ConfigError
from svbrdfgan.io.image import save_image
from svbrdfgan.io.records import load_record
from svbrdfgan.scene.loader import SceneLoader

DATA: dict[str, Any] = {
    "seed": 4,
    "image": [48, 32],
    "texture": 32,
    "embedding": {"name": "hemispherical", "resolution": 32},
    "maps": {"roughness": 0.3},
    "weathering": {"recipe": "smooth-dirt", "amount": {"uniform": [0.3, 1]}, "seed": {"uniform": [0, 99]}},
    "environments": {"procedural": {"count": 2}},
    "splits": {
        "train": {"meshes": {"procedural": {"count": 2, "seed": 1}}, "views": 2},
        "validation": {"meshes": {"procedural": {"count": 1, "seed": 2}}, "views": 1},
    },
    "photography": {"masks": 0.5, "pool": {"procedural": {"count": 1, "seed": 9}}},
}


def config(**changes: Any) -> StagedPhotosConfig:
    return staged_photos_config({**DATA, **changes}, "here")


def shots(folder: Path) -> int:
    return len((folder / "album").read_text().splitlines())


def test_a_photographer_gets_pictures_and_a_manifest_and_the_truth_lies_apart(blender: str, tmp_path: Path) -> None:
    manifest = stage_photos(config(), tmp_path / "out", base=tmp_path, blender=blender)
    contents = read_manifest(yaml.safe_load(manifest.read_text()), "manifest")
    assert len(contents.pictures) == 4
    assert shots(tmp_path) == 4
    masks = [entry.mask is not None for entry in contents.pictures]
    assert 0 < sum(masks) < 4
    dataset = Dataset.open(tmp_path / "out" / "truth")
    assert not (tmp_path / "out" / "truth" / "cache").exists()
    for number, entry in enumerate(contents.pictures):
        photo = load_record(StagedPhoto, tmp_path / "out" / "truth" / "photos" / f"{number:06d}.json")
        assert photo.scene == dataset.index.sampler("train").scene(number)
        off = abs(entry.camera.azimuth_degrees - photo.scene.camera.azimuth_degrees)  # type: ignore[union-attr]
        assert 0 < min(off, 360 - off) <= 1
        assert entry.paint == pytest.approx(next(iter(photo.scene.materials.values())))
        assert Image.open(tmp_path / "out" / entry.file).size == (48, 32)
        if entry.mask:
            mask = np.asarray(Image.open(tmp_path / "out" / entry.mask))
            assert set(np.unique(mask)) == {0, 255}
    imported = import_pictures(
        contents, tmp_path / "own", base=manifest.parent, source=str(manifest), preview=True, display=None
    )
    assert min(picture.iou for picture in imported if picture.iou is not None) > 0.9


def test_what_is_missing_is_taken_and_nothing_twice(
    blender: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FILM", "1")
    with pytest.raises(AssetError, match="Blender ended after 1 of 2 photographs: out of film"):
        stage_photos(config(), tmp_path / "out", base=tmp_path, blender=blender)
    assert not (tmp_path / "out" / "manifest.yaml").exists()
    assert not list((tmp_path / "out").glob(".taking-*"))
    monkeypatch.delenv("FILM")
    manifest = stage_photos(config(), tmp_path / "out", base=tmp_path, blender=blender)
    assert shots(tmp_path) == 4
    whole = manifest.read_text()
    assert stage_photos(config(), tmp_path / "out", base=tmp_path, blender=blender).read_text() == whole
    assert shots(tmp_path) == 4
    with pytest.raises(ConfigError, match=r"taken otherwise \(photography: masks"):
        stage_photos(config(photography={"masks": 1.0}), tmp_path / "out", base=tmp_path, blender=blender)


def test_a_pair_is_two_pictures_from_one_place(blender: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save_image(tmp_path / "frame.exr", torch.full((32, 48, 3), 0.2))
    monkeypatch.setenv("FRAME", str(tmp_path / "frame.exr"))
    entries = {}
    for pairs, view in (("before", "AgX"), ("flash", "Raw"), ("flash", "AgX")):
        data = {**DATA["photography"], "pairs": pairs, "view": view}
        folder = tmp_path / f"{pairs}-{view}"
        manifest = stage_photos(config(photography=data), folder, base=tmp_path, blender=blender, jobs=2)
        contents = read_manifest(yaml.safe_load(manifest.read_text()), "manifest")
        assert len(list((folder / "photos").iterdir())) == 8
        import_pictures(contents, tmp_path / f"own-{pairs}-{view}", base=folder, preview=True)
        entries[pairs, view] = contents.pictures[0]
    before, raw, developed = entries.values()
    assert (before.file, before.before) == ("photos/000000.jpg", "photos/000000-before.jpg")
    assert (raw.file, raw.without_flash) == ("photos/000000-flash.exr", "photos/000000.exr")
    photo = load_record(StagedPhoto, tmp_path / "flash-Raw" / "truth" / "photos" / "000000.json")
    assert photo.flash is not None
    wanted = [photo.flash * gain * photo.scene.camera.distance**2 for gain in photo.gain]
    assert raw.flash == pytest.approx(wanted)
    assert developed.flash is None, "a tone curve changes what white paper is"
    shot = json.loads((tmp_path / "album").read_text().splitlines()[0])
    assert shot["second"]["mesh"] is not None
    assert shot["second"]["flash"] is None


def test_the_balance_of_white_takes_out_the_light_s_colour(blender: str, tmp_path: Path) -> None:
    data = {**DATA["photography"], "white_balance": 1}
    stage_photos(config(photography=data), tmp_path / "out", base=tmp_path, blender=blender)
    dataset = Dataset.open(tmp_path / "out" / "truth")
    photo = load_record(StagedPhoto, tmp_path / "out" / "truth" / "photos" / "000000.json")
    light = SceneLoader(dataset.folder).view(photo.scene).environment.radiance.mean(dim=(0, 1))
    balanced = light * torch.tensor(photo.gain)
    torch.testing.assert_close(balanced, light[1].expand(3), rtol=1e-4, atol=0)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"photography": {"view": "Kodak"}}, "view: 'Kodak' is not known; known are AgX, Filmic, Standard"),
        ({"photography": {"jpeg_quality": 101}}, "wanted numbers from 1 to 100"),
        ({"photography": {"masks": 2}}, "masks"),
        ({"weathering": None}, "weathering is null: name what the photographs show"),
    ],
)
def test_a_wrong_configuration_is_told(changes: dict[str, Any], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        config(**changes)


def test_without_a_blender_nothing_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(ConfigError, match=r"no Blender is here: name one with --blender, or .*svbrdfgan\[blender\]"):
        find_blender()
    with pytest.raises(ConfigError, match="nowhere is no program"):
        stage_photos(config(), tmp_path / "out", base=tmp_path, blender="nowhere")
    assert not (tmp_path / "out").exists()


def test_the_command_says_what_comes_next(blender: str, tmp_path: Path) -> None:
    (tmp_path / "photos.yaml").write_text(yaml.safe_dump(DATA))
    words = ["dataset", "photograph", str(tmp_path / "photos.yaml"), "splits.train.views=1"]
    result = CliRunner().invoke(main, [*words, "-o", str(tmp_path / "out"), "--blender", blender, "--truth"])
    assert result.exit_code == 0, result.output
    assert len(list((tmp_path / "out" / "truth" / "train").glob("*.exr"))) == 2
    assert f"next: svbrdfgan learn {tmp_path / 'out' / 'manifest.yaml'} train.yaml -o RUN" in result.output
