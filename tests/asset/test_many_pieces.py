"""Files of thousands of pieces, materials or names take no longer than their faces do."""

import json
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svbrdfgan.asset import packing, part_words, uv_fitness
from svbrdfgan.asset.asset import Asset, load_asset
from svbrdfgan.asset.memory import Plan, require_plan
from svbrdfgan.asset.orientation import find_orientation
from svbrdfgan.asset.packing import ChartsError, pack
from svbrdfgan.asset.piece_groups import groups
from svbrdfgan.asset.verdicts import judge
from svbrdfgan.asset.weather_document import Textures
from svbrdfgan.io.gltf import primitives
from svbrdfgan.io.gltf.materials import look_of
from svbrdfgan.io.gltf.pieces import document_pieces
from svbrdfgan.io.materials import Look
from svbrdfgan.utils.memory import limited

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 1], [1, 1, 0]], "<f4")
FACES = np.array([0, 1, 2, 1, 3, 2], "<u2")


def crowd(path: Path, count: int, *, materials: int, name: str = "light {}") -> Asset:
    """That many quads side by side, each a mesh and a node of its own, with these materials in turn."""
    binary = CORNERS.tobytes() + FACES.tobytes()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    header: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": list(range(count))}],
        "nodes": [{"mesh": k, "translation": [2 * (k % 50), 0, 2 * (k // 50)]} for k in range(count)],
        "meshes": [
            {"name": name.format(k), "primitives": [{**primitive, "material": k % materials}]} for k in range(count)
        ],
        "materials": [{"name": name.format(k)} for k in range(materials)],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": CORNERS.nbytes},
            {"buffer": 0, "byteOffset": CORNERS.nbytes, "byteLength": FACES.nbytes},
        ],
        "buffers": [{"byteLength": len(binary)}],
    }
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
    return load_asset(path)


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Asset:
    return crowd(tmp_path_factory.mktemp("many") / "many.glb", 2500, materials=2500)


def test_materials_are_grouped_in_the_time_of_a_look_at_each(many: Asset) -> None:
    start = time.perf_counter()
    found = list(groups(many, range(len(many.pieces))))
    assert time.perf_counter() - start < 3.0
    assert [group.pieces for group in found] == [(k,) for k in range(2500)]
    assert not any(group.shared for group in found)


def test_a_material_that_other_pieces_have_is_shared(tmp_path: Path) -> None:
    asset = crowd(tmp_path / "a.glb", 6, materials=3)
    assert [group.shared for group in groups(asset, (0, 1, 4))] == [True, False]
    assert [group.pieces for group in groups(asset, (0, 1, 4))] == [(0,), (1, 4)]


def test_a_material_is_read_once_however_many_primitives_have_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read: list[str] = []

    def counted(*given: Any) -> Look:
        look = look_of(*given)
        read.append(look.part.name)
        return look

    monkeypatch.setattr("svbrdfgan.io.gltf.pieces.look_of", counted)
    crowd(tmp_path / "a.glb", 60, materials=2)
    assert read == ["light 0", "light 1"]
    asset = crowd(tmp_path / "b.glb", 4, materials=2, name="")
    assert [piece.part.name for piece in document_pieces(asset.document)] == ["b"] * 4


def test_the_pieces_of_one_material_are_found_at_once(tmp_path: Path) -> None:
    asset = crowd(tmp_path / "a.glb", 2500, materials=1)
    start = time.perf_counter()
    rows = [asset.faces(piece) for piece in range(2500)]
    corners = asset.corner_vertices
    assert time.perf_counter() - start < 0.5
    np.testing.assert_array_equal(np.concatenate(rows), np.arange(5000))
    np.testing.assert_array_equal(corners[rows[2499]].ravel(), FACES)


def test_names_are_split_a_few_times_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asset, split = crowd(tmp_path / "a.glb", 200, materials=200), part_words.split_words
    counted: list[str] = []
    monkeypatch.setattr(part_words, "split_words", lambda name: (counted.append(name), split(name))[1])
    judge(asset, orientation=find_orientation(asset.mesh, front=None, up=None).matrix())
    assert 0 < len(counted) < 20 * 200


def test_the_uvs_of_few_faces_are_judged_on_a_coarser_raster(monkeypatch: pytest.MonkeyPatch) -> None:
    texels: list[int] = []
    use = uv_fitness.texel_use
    monkeypatch.setattr(
        uv_fitness, "texel_use", lambda p, uv, rows, cols: (texels.append(rows * cols), use(p, uv, rows, cols))[1]
    )
    square = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    space = np.pad(square, ((0, 0), (0, 0), (0, 1)))
    assert uv_fitness.uv_fitness(space, square).fits
    assert texels[0] <= 9000


def test_charts_whose_gutters_fill_the_square_are_not_tried_at_every_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xatlas")
    tries: list[float] = []
    placed = packing._placed
    monkeypatch.setattr(packing, "_placed", lambda mesh, room: (tries.append(room[2]), placed(mesh, room))[1])
    square = np.array([[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]], [[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]]])
    with pytest.raises(ChartsError, match="150 charts do not fit 64 x 64"):
        pack(np.tile(square, (150, 1, 1)), np.repeat(np.arange(150), 2), 64, 4)
    assert len(tries) == 4


def test_many_small_materials_need_no_memory_for_large_textures(many: Asset) -> None:
    plan = Plan.of(many, range(len(many.pieces)), Textures(None, 2048))
    assert set(plan.enough) == {128}
    with limited(4 << 30):
        require_plan(plan)


def test_a_primitive_is_decoded_once_however_often_it_is_shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    document = crowd(tmp_path / "a.glb", 60, materials=1).document
    for number, node in enumerate(document.table("nodes")):
        node |= {"mesh": 0, "scale": [1 if number % 2 else -1, 1, 1]}
    read, counted = primitives.read_accessor, list[int]()
    monkeypatch.setattr(primitives, "read_accessor", lambda *given: (counted.append(given[1]), read(*given))[1])
    pieces = document_pieces(document)
    assert len(pieces) == 60
    assert counted == [1]  # the indices
    assert len({piece.positions.tobytes() for piece in pieces}) == 60
    for piece in pieces:
        assert piece.source is not None
        np.testing.assert_array_equal(
            piece.faces[:, ::-1] if piece.source.mirrored else piece.faces, FACES.reshape(-1, 3)
        )
    assert sum(piece.source.mirrored for piece in pieces if piece.source is not None) == 30
