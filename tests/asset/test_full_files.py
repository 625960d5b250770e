"""Every real file, weathered: what is kept is as it was, to an independent reader, Khronos's validator and Blender."""

from pathlib import Path

import numpy as np
import pytest
from blender import BASIS, opened, sentences
from full_files import FullFile, full_files
from validator import validated
from weathered_files import Weathered, marked, weathered

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.document import write_document

QUICK = {
    "racing_game_chassis_draco.glb": "compressed",
    "toy_car_meshopt.glb": "compressed and quantised",
    "fox_skin_anim.glb": "skinned and animated",
    "texture_transform_test/TextureTransformTest.gltf": "moved textures",
    "alpha_blend_modes.glb": "OPAQUE, MASK and BLEND",
    "cornell_uv2_emissive.glb": "lamps, and two UV sets",
}
EMPTY = "two_scenes_empty.gltf"
NEAR = 1e-3
"""How far a colour may change where no part that weathers is seen: split vertices are rounded in other ways."""
FEW = 16
"""Pixels of 38,400 that may change more: shadow rays that graze an edge, and shadows of see-through parts."""


def flaws(file: FullFile, folder: Path) -> list[str]:
    """One sentence for each thing that weathering should not have done to a file."""
    folder.mkdir()
    changed = weathered(file.path, folder)
    known, found = validated([file.path, changed.path])
    new = sorted({flaw.code for flaw in found} - {flaw.code for flaw in known})
    return [*changed.differences(), *(f"the validator finds {code}." for code in new), *_seen(changed, file, folder)]


def _seen(changed: Weathered, file: FullFile, folder: Path) -> list[str]:
    """What Blender sees that it should not. Light does not bounce, so parts show nothing of each other."""
    if BASIS in file.extensions:
        return []
    before = folder / "before.glb"  # without meshopt, which Blender refuses
    write_document(before, changed.asset.document)
    views = opened(
        [before, changed.path, marked(changed, folder / "marked.glb")], samples=16, size=(240, 160), bounces=0
    )
    weathers = views[2].picture[:, :, 0] > views[2].picture[:, :, 1]
    elsewhere = np.where(weathers, 0.0, np.abs(views[0].picture - views[1].picture).max(axis=2))
    far = int((elsewhere > NEAR).sum())
    found = [f"{far} pixels of kept parts change, by up to {elsewhere.max():.3f}."] if far > FEW else []
    return [*sentences(views[0], views[1]), *found]


def _named(assets: Path, name: str) -> FullFile:
    return next(file for file in full_files(assets) if file.name == name)


@pytest.mark.full
@pytest.mark.assets
@pytest.mark.parametrize("name", QUICK)
def test_a_file_keeps_what_does_not_weather(name: str, assets: Path, tmp_path: Path) -> None:
    assert flaws(_named(assets, name), tmp_path / "file") == []


@pytest.mark.slow
@pytest.mark.assets
@pytest.mark.timeout(7200)
def test_every_file_keeps_what_does_not_weather(assets: Path, tmp_path: Path) -> None:
    files = [file for file in full_files(assets) if file.name != EMPTY]
    assert len(files) == 48
    found = {file.name: flaws(file, tmp_path / str(number)) for number, file in enumerate(files)}
    assert {name: told for name, told in found.items() if told} == {}


@pytest.mark.full
@pytest.mark.assets
def test_a_file_without_faces_is_refused(assets: Path, tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="no faces"):
        weathered(_named(assets, EMPTY).path, tmp_path)
