"""glTF files as JSON, bytes and arrays, read without the product's code.

Every number is decoded as the specification of glTF 2.0 says, so that two files that pack the same data differently
give the same arrays.
"""

import base64
import json
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Num, Shaped
from numpy import ndarray

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SHAPES = {
    "SCALAR": (1, 1),
    "VEC2": (1, 2),
    "VEC3": (1, 3),
    "VEC4": (1, 4),
    "MAT2": (2, 2),
    "MAT3": (3, 3),
    "MAT4": (4, 4),
}
"""Columns and rows of each type of element."""
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
DRACO = "KHR_draco_mesh_compression"

DecodeDraco = Callable[
    [bytes, Mapping[str, int]], tuple[Num[ndarray, " corners"], Mapping[str, Num[ndarray, "vertices width"]]]
]
"""Indices and attributes of one compressed mesh, from its bytes and the attributes' Draco ids by name."""
DecodeMeshopt = Callable[..., bytes]
"""The bytes of a buffer view, from compressed bytes and the keywords count, stride, mode and filter."""


@dataclass(frozen=True)
class Decoders:
    """What decodes compressed geometry; without it, compressed bytes are compared as they are."""

    draco: DecodeDraco | None = None
    meshopt: DecodeMeshopt | None = None


@dataclass(frozen=True)
class Document:
    """A glTF file in memory: its JSON and the bytes that it refers to."""

    path: Path
    json: Mapping[str, Any]
    chunk: bytes
    decoders: Decoders

    def items(self, kind: str) -> list[Any]:
        """The top-level list of this name, such as `meshes`, or an empty one."""
        return self.json.get(kind) or []

    @cached_property
    def buffers(self) -> list[bytes]:
        """The bytes of each buffer; none for a buffer that only stands in for compressed views."""
        return [self._buffer(buffer) for buffer in self.items("buffers")]

    def _buffer(self, buffer: Mapping[str, Any]) -> bytes:
        if "uri" in buffer:
            return self.resource(buffer["uri"])
        fallback = any(name in buffer.get("extensions", {}) for name in MESHOPT)
        return b"" if fallback else self.chunk

    def resource(self, uri: str) -> bytes:
        """The bytes behind a data URI or a path relative to the file."""
        if uri.startswith("data:"):
            head, _, data = uri.partition(",")
            return base64.b64decode(data) if head.endswith(";base64") else unquote(data).encode("latin-1")
        return (self.path.parent / unquote(uri)).read_bytes()

    def view(self, index: int) -> bytes:
        """The bytes of a buffer view, decompressed if there is a decoder."""
        view = self.items("bufferViews")[index]
        packed = next((view["extensions"][name] for name in MESHOPT if name in view.get("extensions", {})), None)
        where = packed or view
        start = where.get("byteOffset", 0)
        data = self.buffers[where["buffer"]][start : start + where["byteLength"]]
        if packed is None or self.decoders.meshopt is None:
            return data
        layout = {"count": packed["count"], "stride": packed["byteStride"], "mode": packed["mode"]}
        return self.decoders.meshopt(data, **layout, filter=packed.get("filter", "NONE"))

    def is_packed(self, index: int) -> bool:
        """Whether the buffer view of this number is compressed and there is no decoder for it."""
        extensions = self.items("bufferViews")[index].get("extensions", {})
        return self.decoders.meshopt is None and any(name in extensions for name in MESHOPT)

    def accessor(self, index: int) -> Shaped[ndarray, "count width"]:
        """The values of an accessor, one row for each element.

        Normalised integers are float64 in [-1, 1]. Where no decoder can read them, the compressed bytes are one column.
        """
        accessor = self.items("accessors")[index]
        if "bufferView" in accessor and self.is_packed(accessor["bufferView"]):
            return np.frombuffer(self.view(accessor["bufferView"]), "u1")[:, None]
        values = self._dense(accessor)
        if "sparse" in accessor:
            values = values.copy()
            values[self._sparse_rows(accessor["sparse"])] = self._sparse_values(accessor)
        return scaled(values, accessor)

    def _dense(self, accessor: Mapping[str, Any]) -> Num[ndarray, "count width"]:
        cols, rows = SHAPES[accessor["type"]]
        kind = np.dtype(COMPONENTS[accessor["componentType"]])
        if "bufferView" not in accessor:
            return np.zeros((accessor["count"], cols * rows), kind)
        data = self.view(accessor["bufferView"])
        stride = self.items("bufferViews")[accessor["bufferView"]].get("byteStride", 0)
        return _elements(data, accessor, accessor.get("byteOffset", 0), stride)

    def _sparse_rows(self, sparse: Mapping[str, Any]) -> Num[ndarray, " changed"]:
        indices = sparse["indices"]
        kind = COMPONENTS[indices["componentType"]]
        return np.frombuffer(self.view(indices["bufferView"]), kind, sparse["count"], indices.get("byteOffset", 0))

    def _sparse_values(self, accessor: Mapping[str, Any]) -> Num[ndarray, "changed width"]:
        sparse = accessor["sparse"]
        changed = {**accessor, "count": sparse["count"]}
        return _elements(self.view(sparse["values"]["bufferView"]), changed, sparse["values"].get("byteOffset", 0), 0)


def _elements(data: bytes, accessor: Mapping[str, Any], start: int, stride: int) -> Num[ndarray, "count width"]:
    """Elements from bytes: columns of matrices start at multiples of four bytes, elements at those of the stride."""
    cols, rows = SHAPES[accessor["type"]]
    kind = np.dtype(COMPONENTS[accessor["componentType"]])
    column = rows * kind.itemsize if cols == 1 else -(-rows * kind.itemsize // 4) * 4
    strides = (stride or cols * column, column, kind.itemsize)
    return np.ndarray((accessor["count"], cols, rows), kind, data, start, strides).reshape(-1, cols * rows)


def scaled(values: Num[ndarray, "count width"], accessor: Mapping[str, Any]) -> Num[ndarray, "count width"]:
    """The values that stored numbers stand for, by what the accessor says."""
    if not accessor.get("normalized") or values.dtype.kind == "f":
        return values
    return np.maximum(values / np.float64(np.iinfo(values.dtype).max), -1)


def read(path: Path | str, decoders: Decoders = Decoders()) -> Document:
    """The document in a .glb or .gltf file."""
    data = Path(path).read_bytes()
    if data[:4] != b"glTF":
        return Document(Path(path), json.loads(data), b"", decoders)
    text, chunk, start = b"", b"", 12
    while start < len(data):
        length, kind = struct.unpack_from("<I4s", data, start)
        body = data[start + 8 : start + 8 + length]
        text, chunk = (body if kind == b"JSON" else text), (body if kind == b"BIN\0" else chunk)
        start += 8 + length
    return Document(Path(path), json.loads(text), chunk, decoders)
