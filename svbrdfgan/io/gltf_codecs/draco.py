"""Decode geometry of KHR_draco_mesh_compression, by the package DracoPy."""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType
from typing import Any

import numpy as np
from jaxtyping import UInt32
from numpy import ndarray

from svbrdfgan.errors import AssetError

TYPES = {1: np.int8, 2: np.uint8, 3: np.int16, 4: np.uint16, 5: np.int32, 6: np.uint32, 9: np.float32}
"""By Draco's number, the type of an attribute's components. DracoPy gives small and signed integers in other types,
which hold each of their values exactly, except those of 32 bits with a sign beyond 2^24; glTF does not have these."""

_KIND, _POINTS = 7, b"\0"  # after the magic number and the version, one byte says what is compressed


def decode(data: bytes, attributes: Mapping[str, int]) -> tuple[UInt32[ndarray, " corners"], dict[str, ndarray]]:
    """The triangles' corners and, by glTF name, the attributes of the vertices, each (vertices, components).

    Attributes are of the type that Draco stored: floats where it quantised floats, integers where it was given
    integers. Triangles and vertices are in Draco's order.

    Args:
        attributes: by glTF name, the attribute's unique number in the Draco data.

    Raises:
        ValueError: the data are broken or have no such attribute.
        AssetError: DracoPy is not installed.
    """
    if data[_KIND : _KIND + 1] == _POINTS:  # said before it is decoded, which would take what the header claims
        raise ValueError("it holds points, not triangles")
    mesh = _decoded(_library(), data)
    known = {attribute["unique_id"]: attribute for attribute in mesh.attributes}
    missing = [f"{name} ({number})" for name, number in attributes.items() if number not in known]
    if missing:
        raise ValueError(f"it has no attribute {missing[0]}; it has {sorted(known)}")
    faces = np.asarray(mesh.faces, np.uint32).reshape(-1)
    arrays = {name: _array(known[number]["data"], known[number]["data_type"]) for name, number in attributes.items()}
    if any(faces.max(initial=0) >= len(array) for array in arrays.values()):
        raise ValueError("its triangles name vertices that it does not have")
    return faces, arrays


def _library() -> ModuleType:
    try:
        import DracoPy
    except ImportError as error:
        raise AssetError(
            "The geometry is compressed with Draco, and the package that reads it is not installed; run `pip install "
            "svbrdfgan[gltf]`, or export the file without compression."
        ) from error
    return DracoPy


def _decoded(library: ModuleType, data: bytes) -> Any:
    try:
        return library.decode(data)
    except Exception as error:  # its exceptions have no common base
        raise ValueError(f"Draco cannot read it ({error})") from error


def _array(data: ndarray, kind: int) -> ndarray:
    if kind not in TYPES:
        raise ValueError(f"it has an attribute of Draco's type {kind}, which glTF does not know")
    return np.asarray(data).reshape(len(data), -1).astype(TYPES[kind])
