"""Arrays of a glTF document: accessors decoded and appended, whatever their layout."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float, Num
from numpy import ndarray

from svbrdfgan.errors import AssetError
from svbrdfgan.io.gltf.document import Document
from svbrdfgan.io.gltf_codecs.plain import COMPONENTS, DTYPES, MAX_ELEMENTS, VERTICES, Json

Matrix = Float[ndarray, "4 4"]

MAX_UNSTORED = 4_000_000
"""Elements of an accessor without bytes, of zeros or with a few named values: a small file can claim more."""

_ALIGNMENT = 4  # of each vertex's numbers, as glTF demands it


def read_accessor(document: Document, index: int) -> Num[ndarray, "count components"]:
    """The values of an accessor as they are stored: sparse and interleaved ones too, of matrices row after row.

    Raises:
        AssetError: the accessor is out of range, or names bytes that do not exist.
    """
    accessors = document.table("accessors")
    if not (isinstance(index, int) and 0 <= index < len(accessors)):
        raise AssetError(f"{document.path} refers to accessor {index}, of {len(accessors)}.")
    entry = accessors[index]
    count, shape = entry["count"], (COMPONENTS[entry["type"]], DTYPES[entry["componentType"]])
    if not (isinstance(count, int) and 0 <= count <= MAX_ELEMENTS):
        raise AssetError(f"{document.path} claims {count} elements in one accessor; wanted at most {MAX_ELEMENTS}.")
    if "bufferView" not in entry and count > MAX_UNSTORED:
        raise AssetError(
            f"{document.path} claims {count} elements without storing them; wanted at most {MAX_UNSTORED}."
        )
    if "bufferView" in entry:
        values = _strided(document, entry, count, *shape)
    else:
        values = np.zeros((count, shape[0]), shape[1])
    return _with_sparse(document, values, entry["sparse"]) if "sparse" in entry else values


def read_floats(document: Document, index: int) -> Num[ndarray, "count components"]:
    """The values of an accessor as float64, where normalised integers become fractions in [0, 1] or [-1, 1]."""
    values, entry = read_accessor(document, index), document.table("accessors")[index]
    if not entry.get("normalized") or values.dtype.kind == "f":
        return values.astype(np.float64)
    return np.maximum(values / float(np.iinfo(values.dtype).max), -1.0)


def append_accessor(document: Document, array: Num[ndarray, "count _"], **keys: Any) -> int:
    """The index of a new accessor of these values, in a buffer view of its own.

    Args:
        array: of float32, uint8, uint16 or uint32; (count,) or (count, 1) for scalars. Positions get their bounds by
            `bounds=True`, and `target` is that of the view.
    """
    array = np.atleast_2d(array.T).T
    kind = next(name for name, size in COMPONENTS.items() if size == array.shape[1])
    component = next(number for number, dtype in DTYPES.items() if np.dtype(dtype) == array.dtype)
    target, bounds = keys.pop("target", VERTICES), keys.pop("bounds", False)
    rows = np.ascontiguousarray(array).view(np.uint8).reshape(len(array), -1)
    gap = -rows.shape[1] % _ALIGNMENT if target == VERTICES else 0
    stride = {"byteStride": rows.shape[1] + gap} if gap else {}
    view = document.add_view(np.pad(rows, ((0, 0), (0, gap))).tobytes(), target=target, **stride)
    entry: Json = {"bufferView": view, "componentType": component, "count": len(array), "type": kind, **keys}
    if bounds:
        entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
    return document.add("accessors", entry)


def _strided(document: Document, entry: Json, count: int, components: int, dtype: str) -> Num[ndarray, "count _"]:
    view = document.table("bufferViews")[entry["bufferView"]]
    start, size = int(entry.get("byteOffset", 0)), _element_size(entry["type"], dtype)
    return _elements(document, entry["bufferView"], start, view.get("byteStride") or size, count, entry["type"], dtype)


def _elements(
    document: Document, view: int, start: int, stride: int, count: int, kind: str, dtype: str
) -> Num[ndarray, "count components"]:
    data, size = document.views[view], _element_size(kind, dtype)
    if count and (start < 0 or stride < size or start + stride * (count - 1) + size > len(data)):
        raise AssetError(f"{document.path} has an accessor that reaches beyond the {len(data)} bytes of its view.")
    if not count:
        return np.zeros((0, COMPONENTS[kind]), dtype)
    raw = np.frombuffer(data, np.uint8, stride * (count - 1) + size, start)
    elements = np.lib.stride_tricks.as_strided(raw, (count, size), (stride, 1), writeable=False)
    columns = _padded_columns(kind, dtype)
    if columns is not None:
        elements = elements[:, columns]
    return np.ascontiguousarray(elements).view(dtype)


def _element_size(kind: str, dtype: str) -> int:
    columns = _padded_columns(kind, dtype)
    item = np.dtype(dtype).itemsize
    return COMPONENTS[kind] * item if columns is None else int(columns[-1]) // 4 * 4 + 4


def _padded_columns(kind: str, dtype: str) -> ndarray | None:
    """The bytes that matrices of small integers use: each of their columns starts at a multiple of four bytes."""
    side, item = {"MAT2": 2, "MAT3": 3, "MAT4": 4}.get(kind), np.dtype(dtype).itemsize
    if side is None or side * item % 4 == 0:
        return None
    pitch = -(-side * item // 4) * 4
    return (np.arange(side)[:, None] * pitch + np.arange(side * item)).ravel()


def _with_sparse(document: Document, values: ndarray, sparse: Json) -> ndarray:
    count, kind = sparse["count"], {size: name for name, size in COMPONENTS.items() if name != "MAT2"}
    places, given = sparse["indices"], sparse["values"]
    dtype = DTYPES[places["componentType"]]
    start, step = int(places.get("byteOffset", 0)), np.dtype(dtype).itemsize
    index = _elements(document, places["bufferView"], start, step, count, "SCALAR", dtype)[:, 0]
    if count and index.max() >= len(values):
        raise AssetError(f"{document.path} has a sparse accessor that names element {index.max()} of {len(values)}.")
    name, stored = kind[values.shape[1]], values.dtype.str
    start, step = int(given.get("byteOffset", 0)), _element_size(name, stored)
    changed = values.copy()
    changed[index.astype(np.int64)] = _elements(document, given["bufferView"], start, step, count, name, stored)
    return changed
