"""What is written beside a weathered scene, and what is told of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from svbrdfgan.asset.weather_document import Edited, Textures
from svbrdfgan.errors import AssetError
from svbrdfgan.inference.weathered_file import overlaid_document, weathered_document, write_maps, write_weathered
from svbrdfgan.inference.weatherings import RecipeWeathering
from svbrdfgan.inference.workpiece import Workpiece, open_workpiece
from svbrdfgan.io.eight_bit import png_bytes
from svbrdfgan.io.gltf.document import Document
from svbrdfgan.io.gltf.surface_files import save_mesh_glb
from svbrdfgan.procedural.kinds import sample_vehicle
from svbrdfgan.procedural.vehicle import build_vehicle
from svbrdfgan.weathering.recipes import Dust

SMALL = Textures(64, 32)


@pytest.fixture(scope="module")
def van(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("van") / "van.glb"
    save_mesh_glb(path, build_vehicle(sample_vehicle("van", 5)))
    return path


def opened(van: Path, **given: tuple[str, ...]) -> Workpiece:
    workpiece = open_workpiece(van, front="+Z", up="+Y", **given)
    workpiece.asset.document.changes.append("something was compressed.")
    return workpiece


@pytest.mark.parametrize("keep", [(), ("*",)], ids=["weathered", "kept"])
def test_what_reading_changed_is_told_whatever_weathers(van: Path, keep: tuple[str, ...]) -> None:
    workpiece, dust = opened(van, keep=keep), RecipeWeathering(Dust())
    assert weathered_document(workpiece, dust, SMALL).told[0] == "something was compressed."
    assert overlaid_document(workpiece, dust, SMALL).edited.told[0] == "something was compressed."


def test_maps_that_the_layer_leaves_alone_are_written_in_their_own_format(tmp_path: Path) -> None:
    document = Document({"asset": {"version": "2.0"}}, [], tmp_path / "a.glb")
    pictures = (png_bytes(np.zeros((2, 2, 3), np.uint8)), b"\xabKTX 20\xbb\r\n\x1a\n", b"\xff\xd8\xff\xe0")
    for number, data in enumerate(pictures):
        document.add("images", {"bufferView": document.add_view(data), "mimeType": "image/any"})
        document.add("textures", {"source": number})
    color = {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}
    rest = {"normalTexture": {"index": 1}, "emissiveTexture": {"index": 2}}
    for _ in range(2):
        document.add("materials", {"name": "paint", **color, **rest})
    names = [path.name for path in write_maps(tmp_path, Edited(document, materials=[0, 1]))]
    maps = ("base_color.png", "normal.ktx2", "emissive.jpg")
    assert names == [f"{material}.{name}" for material in ("paint", "paint.1") for name in maps]


@pytest.mark.parametrize("name", ["../../out", "/etc/paint", "a\\b", "..", "con\x00trol\x1b[2J\n", "\u202egpj"])
def test_names_of_materials_do_not_lead_out_of_the_folder(name: str, tmp_path: Path) -> None:
    document = Document({"asset": {"version": "2.0"}}, [], tmp_path / "a.glb")
    document.add("images", {"bufferView": document.add_view(png_bytes(np.zeros((2, 2, 3), np.uint8)))})
    document.add("textures", {"source": 0})
    document.add("materials", {"name": name, "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}})
    (path,) = write_maps(tmp_path / "maps", Edited(document, materials=[0]))
    assert path.parent == tmp_path / "maps"
    assert path.name.isprintable()
    assert [file for file in tmp_path.rglob("*") if file.is_file()] == [path]


def test_python_takes_a_recipe_and_spares_the_source(van: Path, tmp_path: Path) -> None:
    before = van.read_bytes()
    written = write_weathered(tmp_path / "dusty.glb", van, Dust(), SMALL, front="+Z", up="+Y")
    assert written.paths == (tmp_path / "dusty.glb",)
    with pytest.raises(AssetError, match="is the input mesh"):
        write_weathered(van, van, Dust(), SMALL)
    assert van.read_bytes() == before


def test_a_clean_layer_changes_nothing(van: Path) -> None:
    workpiece = opened(van)
    clean = weathered_document(workpiece, RecipeWeathering(Dust(amount=0.0)), SMALL)
    assert clean.document.header == workpiece.asset.document.header
    assert clean.materials == []


def test_patterns_are_sized_by_the_length_that_is_given(van: Path, tmp_path: Path) -> None:
    """The van's own length in metres changes nothing, and another does."""
    own = opened(van).surroundings.grounds.metres
    files = [tmp_path / f"{name}.glb" for name in ("found", "given", "toy")]
    for path, length in zip(files, (None, own, 0.3), strict=True):
        write_weathered(path, van, Dust(), SMALL, length=length)
    found, given, toy = (path.read_bytes() for path in files)
    assert found == given != toy
