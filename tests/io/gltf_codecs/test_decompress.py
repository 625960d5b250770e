"""A document without compression says the same as the compressed one."""

import base64
import copy
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_codecs.decompress import decompressed
from svbrdfgan.io.gltf_codecs.plain import COMPONENTS, DTYPES

STREAMS: list[dict[str, Any]] = json.loads(Path(__file__).with_name("meshopt_streams.json").read_text())
STREAM = next(stream for stream in STREAMS if stream["mode"] == "TRIANGLES" and stream["stride"] == 2)
MESHOPT = "EXT_meshopt_compression"


def packed() -> tuple[dict[str, Any], list[bytes]]:
    """A document with a fallback buffer before the one that has data, and a buffer view without compression."""
    data, size = bytes.fromhex(STREAM["data"]), STREAM["count"] * 2
    packing = {"buffer": 1, "byteOffset": 4, "byteLength": len(data), "byteStride": 2}
    packing |= {"mode": "TRIANGLES", "count": STREAM["count"]}
    view = {"buffer": 0, "byteLength": size, "extensions": {MESHOPT: packing, "EXT_other": {}}, "name": "kept"}
    header = {
        "asset": {"version": "2.0"},
        "extensionsRequired": [MESHOPT],
        "extensionsUsed": ["KHR_mesh_quantization", MESHOPT],
        "buffers": [{"byteLength": size, "extensions": {MESHOPT: {"fallback": True}}}, {"byteLength": 4 + len(data)}],
        "bufferViews": [view, {"buffer": 1, "byteLength": 4}],
        "accessors": [{"bufferView": 0, "componentType": 5123, "count": STREAM["count"], "type": "SCALAR"}],
        "extras": {"a": 1},
    }
    return header, [b"", b"abcd" + data]


def load(path: Path) -> tuple[dict[str, Any], list[bytes]]:
    data = path.read_bytes()
    if data[:4] != b"glTF":
        header = json.loads(data)
        return header, [base64.b64decode(buffer["uri"].partition(",")[2]) for buffer in header["buffers"]]
    size = struct.unpack_from("<I", data, 12)[0]
    header = json.loads(data[20 : 20 + size])
    return header, [data[28 + size :], *[b""] * (len(header["buffers"]) - 1)]


def values(header: dict[str, Any], buffers: list[bytes], index: int) -> np.ndarray:
    accessor = header["accessors"][index]
    view = header["bufferViews"][accessor["bufferView"]]
    dtype, columns = np.dtype(DTYPES[accessor["componentType"]]), COMPONENTS[accessor["type"]]
    stride = view.get("byteStride", dtype.itemsize * columns)
    start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
    assert start % dtype.itemsize == 0
    assert start + stride * accessor["count"] <= view.get("byteOffset", 0) + view["byteLength"]
    buffer = buffers[view["buffer"]]
    return np.ndarray((accessor["count"], columns), dtype, buffer, start, (stride, dtype.itemsize))


def test_meshopt_goes_and_all_else_stays() -> None:
    header, buffers = packed()
    before = copy.deepcopy(header)
    plain, data, done = decompressed(header, buffers, "a.glb")
    assert header == before
    assert done == ("1 buffer view was compressed with meshopt; it comes out uncompressed",)
    assert values(plain, data, 0).tobytes() == bytes.fromhex(STREAM["decoded"])
    assert len(data) == len(plain["buffers"]) == 2  # the fallback is gone
    assert data[plain["bufferViews"][1]["buffer"]] == buffers[1]
    assert plain["bufferViews"][0]["extensions"] == {"EXT_other": {}}
    assert plain["bufferViews"][0]["name"] == "kept"
    assert "extensionsRequired" not in plain
    assert plain["extensionsUsed"] == ["KHR_mesh_quantization"]
    assert plain["extras"] == {"a": 1}
    assert MESHOPT not in json.dumps(plain)
    assert [len(some) for some in data] == [buffer["byteLength"] for buffer in plain["buffers"]]


def test_a_document_without_compression_comes_back_equal() -> None:
    header = {"asset": {"version": "2.0"}, "buffers": [{"byteLength": 4}], "extensionsUsed": ["KHR_lights_punctual"]}
    assert decompressed(header, [b"abcd"], "a.glb") == (header, [b"abcd"], ())


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"count": 150_000_001}, "150000001"),
        ({"count": 3}, "left over|too early"),
        ({"byteLength": 10_000}, "10004"),
        ({"byteOffset": -4}, "bytes"),
        ({"mode": "STRIPS"}, "STRIPS"),
        ({"buffer": 9}, "IndexError"),
        ({"count": None}, "TypeError"),
    ],
)
def test_a_broken_buffer_view_is_refused_by_name(change: dict[str, Any], reason: str) -> None:
    header, buffers = packed()
    header["bufferViews"][0]["extensions"][MESHOPT] |= change
    with pytest.raises(AssetError, match=rf"^broken\.glb.*({reason})"):
        decompressed(header, buffers, "broken.glb")


@pytest.mark.assets
@pytest.mark.parametrize(
    "name",
    [
        *("market_van_draco.gltf", "racing_game_chassis_draco.glb", "folio2025_jeep_draco_ktx2.glb"),
        *("chess_board_draco_clearcoat.glb", "dense_sphere_quantized_draco.glb"),
    ],
)
def test_real_draco_files_have_the_geometry_that_their_accessors_state(assets: Path, name: str) -> None:
    pytest.importorskip("DracoPy")
    header, buffers = load(assets / "full" / name)
    plain, data, done = decompressed(header, buffers, name)
    primitives = [p for mesh in plain["meshes"] for p in mesh["primitives"]]
    number = len(primitives)
    assert done[0].startswith(f"{number} primitive")
    assert "KHR_draco_mesh_compression" not in json.dumps(plain)
    for primitive in primitives:
        stated = header["accessors"][primitive["attributes"]["POSITION"]]
        positions = values(plain, data, primitive["attributes"]["POSITION"])
        size = np.ptp([stated["min"], stated["max"]])
        assert len(positions) == stated["count"]
        np.testing.assert_allclose(positions.min(axis=0), stated["min"], atol=size * 1e-3)
        np.testing.assert_allclose(positions.max(axis=0), stated["max"], atol=size * 1e-3)
        indices = values(plain, data, primitive["indices"])
        assert len(indices) == header["accessors"][primitive["indices"]]["count"]
        assert indices.max() < len(positions)
        for index in primitive["attributes"].values():
            assert len(values(plain, data, index)) == stated["count"]
            view = plain["bufferViews"][plain["accessors"][index]["bufferView"]]
            assert view.get("byteStride", 4) % 4 == 0
        bounds = plain["accessors"][primitive["attributes"]["POSITION"]]
        assert bounds["max"] == positions.max(axis=0).tolist()


@pytest.mark.assets
def test_a_real_meshopt_file_keeps_its_bounds(assets: Path) -> None:
    header, buffers = load(assets / "full" / "toy_car_meshopt.glb")
    plain, data, _ = decompressed(header, buffers, "toy")
    assert len(data) == 2
    bounded = [index for index, accessor in enumerate(header["accessors"]) if "min" in accessor]
    assert bounded
    for index in bounded:
        found = values(plain, data, index)
        assert found.min(axis=0).tolist() == header["accessors"][index]["min"]
        assert found.max(axis=0).tolist() == header["accessors"][index]["max"]
