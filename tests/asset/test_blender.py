"""Blender opens files, sees the same in the same, and sees what was changed."""

from pathlib import Path

import numpy as np
import pytest
from blender import NOT_OPENED, compare, opened
from full_files import vehicles
from sample_document import Pieces, sample_document, write

pytestmark = pytest.mark.full


def visible() -> Pieces:
    """The sample without what Blender cannot open: pictures of nothing, skins of noise, and pointers into materials."""
    pieces = sample_document()
    del pieces["materials"][0]["normalTexture"], pieces["materials"][0]["extensions"]
    del pieces["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]
    del pieces["nodes"][6]["skin"], pieces["nodes"][7], pieces["animations"][0]["channels"][1]
    for kind in ("images", "textures"):
        pieces[kind] = []
    pieces["extensionsRequired"] = []
    return pieces


def test_blender_sees_what_was_changed(tmp_path: Path) -> None:
    pieces = visible()
    before = write(pieces, tmp_path / "before.glb")
    pieces["nodes"][6]["translation"] = [2, 0, 0]
    pieces["nodes"][2]["name"] = "Spare wheel"
    pieces["materials"][0]["name"] = "Paint.001"
    pieces["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [1, 0, 0, 1]
    seen = compare(before, write(pieces, tmp_path / "after.glb"))
    told = " ".join(seen.sentences)
    assert "object 'Wheel.R' is gone." in told
    assert "object 'Spare wheel' is new." in told
    assert "object 'Driver': its matrix was" in told
    assert "Paint" not in told
    assert seen.change.max() > 0.1


@pytest.mark.assets
def test_a_file_looks_the_same_twice(assets: Path) -> None:
    car = assets / "full" / "cesium_milk_truck.glb"
    seen = compare(car, car)
    assert seen.sentences == []
    assert seen.change.max() == 0
    (once,) = opened([car], samples=1)
    assert set(once.materials) == {"truck", "window_trim", "glass", "wheels"}
    assert np.ptp(once.picture) > 0.3


@pytest.mark.assets
def test_blender_opens_the_vehicles_whose_extensions_it_knows(assets: Path) -> None:
    known = [file for file in vehicles(assets) if file.extensions.isdisjoint(NOT_OPENED)]
    assert len(known) == 14
    for file, seen in zip(known, opened([file.path for file in known], samples=1), strict=True):
        assert len(seen.objects) >= file.meshes, file.name


@pytest.mark.assets
def test_blender_refuses_what_it_does_not_know(assets: Path) -> None:
    with pytest.raises(RuntimeError, match="EXT_meshopt_compression"):
        opened([assets / "full" / "toy_car_meshopt.glb"], samples=1)
