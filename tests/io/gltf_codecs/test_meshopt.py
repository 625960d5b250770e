"""The streams of meshopt decode to what meshoptimizer's own decoder makes of them."""

import hashlib
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svbrdfgan.io.gltf_codecs.meshopt import decode
from svbrdfgan.io.gltf_codecs.meshopt_attributes import decode_attributes

STREAMS: list[dict[str, Any]] = json.loads(Path(__file__).with_name("meshopt_streams.json").read_text())
"""Encoded and decoded by meshoptimizer 1.3: both versions of attributes, each filter, triangles and indices."""

NUMBERS = {("COLOR", 4): "u1", ("COLOR", 8): "u2", ("OCTAHEDRAL", 4): "i1", ("EXPONENTIAL", 12): "f4"}


def unpacked(stream: dict[str, Any], data: bytes | None = None) -> bytes:
    layout = {key: stream[key] for key in ("count", "stride", "mode", "filter")}
    return decode(bytes.fromhex(stream["data"]) if data is None else data, **layout)


@pytest.mark.parametrize("stream", STREAMS, ids=lambda s: f"{s['mode']}-{s['filter']}-{s['stride']}-{s['count']}")
def test_a_stream_decodes_as_in_the_reference(stream: dict[str, Any]) -> None:
    got, wanted = unpacked(stream), bytes.fromhex(stream["decoded"])
    if stream["filter"] in ("NONE", "EXPONENTIAL"):
        assert got == wanted
    else:  # the specification allows filters one unit in the last place
        dtype = NUMBERS.get((stream["filter"], stream["stride"]), "i2")
        assert np.abs(np.frombuffer(got, dtype).astype(int) - np.frombuffer(wanted, dtype)).max() <= 1


def test_the_streams_have_every_mode_filter_and_version() -> None:
    assert {stream["mode"] for stream in STREAMS} == {"ATTRIBUTES", "TRIANGLES", "INDICES"}
    assert {s["filter"] for s in STREAMS} == {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL", "COLOR"}
    assert {s["data"][:2] for s in STREAMS} == {"a0", "a1", "e1", "d1"}


def test_the_specifications_example_of_a_group() -> None:
    group = bytes.fromhex("175ff0bc77a9210034b5")
    others = b"\0" * 3  # the headers of three bytes whose deltas are all zero
    elements = decode_attributes(b"\xa0" + b"\x02" + group + others + bytes(32), 16, 4)
    deltas = [-1, -4, -3, 26, -91, 0, -6, 6, -4, -4, 5, -5, 1, -1, 0, 0]
    np.testing.assert_array_equal(elements[:, 0], np.cumsum(deltas).astype(np.uint8))
    assert not elements[:, 1:].any()


def literal(elements: np.ndarray) -> bytes:
    """A stream of version 1 that stores all deltas as bytes, compared with zero at first."""
    count, stride = elements.shape
    deltas = np.diff(elements, axis=0, prepend=np.uint8(0))
    codes = (deltas << 1) ^ -(deltas >> 7)
    size = min(8192 // stride // 16 * 16, 256)
    blocks = [b"\xff" * (stride // 4) + codes[start : start + size].T.tobytes() for start in range(0, count, size)]
    return b"\xa1" + b"".join(blocks) + bytes(max(24, stride + stride // 4))


@pytest.mark.parametrize(("count", "stride"), [(256, 4), (600, 4), (100, 256), (96, 256), (500, 20)])
def test_elements_of_many_blocks_keep_their_places(count: int, stride: int) -> None:
    elements = np.random.default_rng(0).integers(0, 256, (count, stride), dtype=np.uint8)
    assert decode(literal(elements), count=count, stride=stride, mode="ATTRIBUTES") == elements.tobytes()


def test_triangles_may_begin_their_count_anew() -> None:
    data = b"\xe1" + b"\xfe\xfe\xf0" + b"\x00\x00" + bytes(16)
    indices = np.frombuffer(decode(data, count=9, stride=2, mode="TRIANGLES"), "<u2")
    assert indices.tolist() == [0, 1, 2, 0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("stream", STREAMS[::3])
def test_a_stream_of_another_length_is_refused(stream: dict[str, Any]) -> None:
    data = bytes.fromhex(stream["data"])
    for broken in (b"", data[:1], data[: len(data) // 2], data[:-1], data + b"\0", b"\xff" + data[1:]):
        with pytest.raises(ValueError, match=r"."):
            unpacked(stream, broken)


@pytest.mark.parametrize("mode", ["ATTRIBUTES", "TRIANGLES", "INDICES"])
def test_a_lying_count_is_refused_before_memory_is_taken(mode: str) -> None:
    head = {"ATTRIBUTES": b"\xa1", "TRIANGLES": b"\xe1", "INDICES": b"\xd1"}[mode]
    with pytest.raises(ValueError, match="too early"):
        decode(head + bytes(100), count=3 * 10**15, stride=4, mode=mode)  # 12 petabytes


@pytest.mark.parametrize(
    ("layout", "reason"),
    [
        ({"mode": "STRIPS"}, "mode"),
        ({"filter": "ZIP"}, "filter"),
        ({"filter": "QUATERNION"}, "4 bytes"),
        ({"stride": 6}, "6 bytes"),
        ({"mode": "TRIANGLES", "count": 4}, "4 elements"),
        ({"mode": "TRIANGLES", "filter": "COLOR"}, "COLOR"),
        ({"count": 0}, "0 elements"),
    ],
)
def test_a_layout_that_no_stream_has_is_refused(layout: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        decode(b"\xa0" + bytes(40), **({"count": 3, "stride": 4, "mode": "ATTRIBUTES"} | layout))


def test_a_triangle_may_not_use_an_edge_that_was_never_there() -> None:
    with pytest.raises(ValueError, match="not there"):
        decode(b"\xe1\x00" + bytes(16), count=3, stride=4, mode="TRIANGLES")


@pytest.mark.assets
def test_a_real_vehicle_decodes_as_in_the_reference(assets: Path) -> None:
    data = (assets / "full" / "toy_car_meshopt.glb").read_bytes()
    size = struct.unpack_from("<I", data, 12)[0]
    header, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    digest = hashlib.sha256()
    for view in header["bufferViews"]:
        if packing := view.get("extensions", {}).get("EXT_meshopt_compression"):
            stream = binary[packing["byteOffset"] :][: packing["byteLength"]]
            shape = {"count": packing["count"], "stride": packing["byteStride"], "mode": packing["mode"]}
            digest.update(decode(stream, filter=packing.get("filter", "NONE"), **shape))
    assert digest.hexdigest() == "72ccb1979da8b4d7555954da145b2f62314e2cda179e307f7934d1f9b62b032e"
