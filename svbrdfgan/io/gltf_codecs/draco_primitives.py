"""Replace the primitives of a glTF document that Draco compressed by plain ones."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy import ndarray

from svbrdfgan.io.gltf_codecs.draco import decode
from svbrdfgan.io.gltf_codecs.plain import (
    COMPONENTS,
    DTYPES,
    INDICES,
    VERTICES,
    Json,
    NewBuffer,
    slice_of,
    without_extensions,
)

DRACO = "KHR_draco_mesh_compression"

UINT, FLOAT = 5125, 5126  # of glTF's component types
TRIANGLES = 4


@dataclass
class _Document:
    """The tables that change, and where the values of each accessor and source were placed."""

    header: Json
    buffers: list[bytes]
    new: NewBuffer
    accessors: list[Json]
    views: list[Json]
    placed: dict[tuple[int | None, int, int | None], int] = field(default_factory=dict)


def without_draco(header: Json, buffers: list[bytes]) -> tuple[Json, list[bytes], int]:
    """A header and buffers in which no primitive is compressed with Draco, and how many were.

    Accessors get the values that Draco gives, with their count and bounds. If the file has a primitive uncompressed,
    too, these values are used instead.

    Raises:
        ValueError: Draco's data are broken or do not fit the accessors.
        AssetError: DracoPy is not installed.
    """
    meshes = header.get("meshes", [])
    count = sum(DRACO in primitive.get("extensions", {}) for mesh in meshes for primitive in mesh["primitives"])
    if not count:
        return header, buffers, 0
    accessors, views = list(header["accessors"]), list(header["bufferViews"])
    document = _Document(header, buffers, NewBuffer(len(buffers)), accessors, views)
    plain = [{**mesh, "primitives": [_plain(document, p) for p in mesh["primitives"]]} for mesh in meshes]
    changed = {**header, "meshes": plain, "accessors": accessors, "bufferViews": views}
    if document.new.size:
        changed["buffers"] = [*header["buffers"], document.new.description()]
        buffers = [*buffers, document.new.data()]
    return changed, buffers, count


def _plain(document: _Document, primitive: Json) -> Json:
    packing = primitive.get("extensions", {}).get(DRACO)
    if packing is None:
        return primitive
    plain = without_extensions(primitive, (DRACO,))
    accessors = primitive["attributes"]
    numbers = {name: number for name, number in packing["attributes"].items() if name in accessors}
    used = [primitive.get("indices"), *(accessors[name] for name in numbers)]
    if all(index is not None and "bufferView" in document.header["accessors"][index] for index in used):
        return plain
    view = packing["bufferView"]
    corners, arrays = _decoded(document, view, numbers)
    attributes = {
        name: _placed(document, accessors[name], (view, numbers[name]), values) for name, values in arrays.items()
    }
    indices = _placed(document, primitive.get("indices"), (view, None), corners)
    return {**plain, "attributes": accessors | attributes, "indices": indices, "mode": TRIANGLES}


def _decoded(document: _Document, view: int, numbers: dict[str, int]) -> tuple[ndarray, dict[str, ndarray]]:
    try:
        corners, arrays = decode(slice_of(document.header["bufferViews"][view], document.buffers), numbers)
    except ValueError as error:
        raise ValueError(f"Draco's buffer view {view}: {error}") from error
    return corners[:, None], arrays


def _placed(document: _Document, index: int | None, source: tuple[int, int | None], values: ndarray) -> int:
    """The index of the accessor that has these values: the given one, or a copy if that has others already."""
    key = (index, *source)
    if key not in document.placed:
        empty = {"componentType": UINT, "count": 0, "type": "SCALAR"}
        accessor = empty if index is None else document.accessors[index]
        filled = _filled(document, accessor, values, VERTICES if source[1] is not None else INDICES)
        if index is None or "bufferView" in accessor:
            document.accessors.append(filled)
            index = len(document.accessors) - 1
        else:
            document.accessors[index] = filled
        document.placed[key] = index
    return document.placed[key]


def _filled(document: _Document, accessor: Json, values: ndarray, target: int) -> Json:
    kind = accessor["componentType"]
    if values.shape[1] != COMPONENTS.get(accessor["type"]):
        raise ValueError(f"Draco has {values.shape[1]} components for an accessor of type {accessor['type']}")
    if target == INDICES and values.max(initial=0) > np.iinfo(DTYPES[kind]).max:
        kind = UINT
    stored = values.astype(DTYPES[kind])
    if kind != FLOAT and not np.array_equal(stored, values):
        raise ValueError(f"Draco's values do not fit the accessor's component type {kind}")
    document.views.append(document.new.add(_rows(stored, target)) | {"target": target})
    size = stored.itemsize * stored.shape[1]
    if target == VERTICES and size % 4:
        document.views[-1]["byteStride"] = size + -size % 4
    place = {"bufferView": len(document.views) - 1, "byteOffset": 0, "componentType": kind, "count": len(stored)}
    bounds = {"min": stored.min(axis=0), "max": stored.max(axis=0)}
    return {**accessor, **place, **{name: value.tolist() for name, value in bounds.items() if name in accessor}}


def _rows(values: ndarray, target: int) -> bytes:
    """The values' bytes; vertices begin at multiples of four bytes, as glTF demands."""
    data = np.ascontiguousarray(values).view(np.uint8)
    padding = -data.shape[1] % 4 if target == VERTICES else 0
    return np.pad(data, ((0, 0), (0, padding))).tobytes()
