"""Draco gives each attribute by its number, in the type that it stored."""

import builtins
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf_codecs.draco import decode

QUAD = Path(__file__).with_name("quad.drc").read_bytes()
"""Two triangles with attributes of every type, encoded by Google's draco3d 1.5.9 for JavaScript."""

NUMBERS = {"POSITION": 0, "NORMAL": 1, "JOINTS_0": 2, "JOINTS_1": 3, "COLOR_0": 4, "WEIGHTS_0": 5, "_S": 6, "_I": 7}
JOINTS = [[1, 0, 0, 0], [3, 4, 5, 6], [7, 8, 9, 10]]


def test_attributes_come_in_their_own_types() -> None:
    pytest.importorskip("DracoPy")
    corners, arrays = decode(QUAD, NUMBERS | {"TEXCOORD_0": 8})
    assert corners.tolist() == [0, 1, 2, 2, 1, 3]
    wanted = {
        "POSITION": np.int16([[-300, 0, 5], [200, 1, 6], [7, -8, 9], [1000, 11, -12]]),
        "NORMAL": np.int8([[-127, 0, 0], [0, 127, 0], [0, 0, -127], [1, -2, 3]]),
        "JOINTS_0": np.uint8([[0, 1, 2, 250], *JOINTS]),
        "JOINTS_1": np.uint16([[0, 1, 2, 65000], *JOINTS]),
        "COLOR_0": np.uint16([[0, 1, 2, 65000], *JOINTS]),
        "WEIGHTS_0": np.float32([[0.5, 0.5, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0.25] * 4]),
        "_S": np.int16([[-5], [5], [-30000], [30000]]),
        "_I": np.int32([[-5], [5], [-3000000], [3000000]]),
        "TEXCOORD_0": np.uint16([[0, 0], [65535, 0], [0, 65535], [65535, 65535]]),
    }
    assert arrays.keys() == wanted.keys()
    for name, array in arrays.items():
        assert array.dtype == wanted[name].dtype, name
        np.testing.assert_array_equal(array, wanted[name], err_msg=name)


@pytest.mark.parametrize("data", [b"", b"DRACO", QUAD[:60], b"xxxxx" + QUAD[5:]])
def test_broken_data_are_refused(data: bytes) -> None:
    pytest.importorskip("DracoPy")
    with pytest.raises(ValueError, match="Draco cannot read it"):
        decode(data, {"POSITION": 0})


def test_an_attribute_that_is_not_there_is_named() -> None:
    pytest.importorskip("DracoPy")
    with pytest.raises(ValueError, match=r"no attribute TANGENT \(77\)"):
        decode(QUAD, {"POSITION": 0, "TANGENT": 77})


def test_without_the_package_the_message_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **options: Any) -> Any:
        if name == "DracoPy":
            raise ImportError(name)
        return real(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(AssetError, match=r"pip install svbrdfgan\[gltf\]"):
        decode(QUAD, {"POSITION": 0})
