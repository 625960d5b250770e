"""Where the values of Draco go in a document, by the quad of `test_draco.py`."""

from pathlib import Path
from typing import Any

import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_codecs.decompress import decompressed

pytest.importorskip("DracoPy")
QUAD = Path(__file__).with_name("quad.drc").read_bytes()
DRACO = "KHR_draco_mesh_compression"


def quad(**changes: Any) -> dict[str, Any]:
    packing = {"bufferView": 0, "attributes": {"POSITION": 0, "JOINTS_0": 2}}
    primitive = {"attributes": {"POSITION": 0, "JOINTS_0": 1}, "indices": 2, "extensions": {DRACO: packing}}
    position = {"componentType": 5122, "count": 4, "type": "VEC3", "min": [0, 0, 0], "max": [1, 1, 1]}
    return {
        "buffers": [{"byteLength": len(QUAD)}],
        "bufferViews": [{"buffer": 0, "byteLength": len(QUAD)}],
        "accessors": [
            position | changes,
            {"componentType": 5121, "count": 9, "type": "VEC4"},
            {"componentType": 5121, "count": 6, "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [primitive]}],
    }


def test_vertices_begin_at_multiples_of_four_bytes() -> None:
    plain, data, _ = decompressed(quad(), [QUAD], "quad")
    position = plain["accessors"][0]
    view = plain["bufferViews"][position["bufferView"]]
    assert view["byteStride"] == 8  # six bytes and two of padding
    assert view["byteLength"] == 32
    assert (position["min"], position["max"]) == ([-300, -8, -12], [1000, 11, 9])
    assert plain["accessors"][1]["count"] == 4  # the file claimed nine
    assert [len(some) for some in data] == [buffer["byteLength"] for buffer in plain["buffers"]]


def test_primitives_of_one_source_share_its_accessors() -> None:
    header = quad()
    header["meshes"][0]["primitives"][0]["mode"] = 5  # Draco gives triangles of what was a strip
    header["meshes"][0]["primitives"] *= 2
    plain, _, done = decompressed(header, [QUAD], "quad")
    assert done == ("2 primitives were compressed with Draco; they come out uncompressed",)
    assert {primitive["mode"] for primitive in plain["meshes"][0]["primitives"]} == {4}
    assert plain["accessors"] == decompressed(quad(), [QUAD], "quad")[0]["accessors"]


def test_sources_that_name_one_accessor_get_one_each() -> None:
    header = quad()
    first = header["meshes"][0]["primitives"][0]
    other = {"bufferView": 1, "attributes": first["extensions"][DRACO]["attributes"]}
    header["bufferViews"].append(header["bufferViews"][0])
    header["meshes"][0]["primitives"].append({**first, "extensions": {DRACO: other}})
    plain, _, _ = decompressed(header, [QUAD], "quad")
    used = [p["attributes"]["POSITION"] for p in plain["meshes"][0]["primitives"]]
    assert used[0] != used[1]
    assert len(plain["accessors"]) == 6


@pytest.mark.parametrize(
    ("change", "reason"),
    [({"type": "VEC2"}, "VEC2"), ({"componentType": 5120}, "do not fit"), ({"count": 150_000_001}, "150000001")],
)
def test_an_accessor_that_does_not_fit_is_refused(change: dict[str, Any], reason: str) -> None:
    with pytest.raises(AssetError, match=f"^quad.*{reason}"):
        decompressed(quad(**change), [QUAD], "quad")


def test_what_the_file_also_has_uncompressed_is_used() -> None:
    header = quad(bufferView=0)
    for accessor in header["accessors"]:
        accessor["bufferView"] = 0
    plain, data, _ = decompressed(header, [QUAD], "quad")
    assert (plain["accessors"], data) == (header["accessors"], [QUAD])
    assert "extensions" not in plain["meshes"][0]["primitives"][0]
