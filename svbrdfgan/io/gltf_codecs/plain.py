"""Plain buffers of a glTF document: cut out, put together, and freed of extensions."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field
from typing import Any

Json = dict[str, Any]

MAX_ELEMENTS = 150_000_000
"""Per accessor: the corners of 50 million triangles. A header that claims more is broken, and would fill the memory."""

COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""NumPy's types by glTF's `componentType`, OpenGL enumerants."""

VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""


@dataclass
class NewBuffer:
    """A buffer under construction, at this index of the document's buffers."""

    index: int
    parts: list[bytes] = field(default_factory=list)
    size: int = 0

    def add(self, data: bytes) -> Json:
        """The keys of the buffer view at which the data now are; it begins at a multiple of four bytes."""
        start = self.size
        self.parts += [data, bytes(-len(data) % 4)]
        self.size += len(data) + -len(data) % 4
        return {"buffer": self.index, "byteOffset": start, "byteLength": len(data)}

    def data(self) -> bytes:
        """The content so far."""
        return b"".join(self.parts)

    def description(self) -> Json:
        """The entry in the document's list of buffers."""
        return {"byteLength": self.size}


def slice_of(view: Json, buffers: list[bytes]) -> bytes:
    """The bytes that a buffer view, or an extension with the same keys, names.

    Raises:
        ValueError: the buffer is shorter.
    """
    start, length = view.get("byteOffset", 0), view["byteLength"]
    buffer = buffers[view["buffer"]]
    if start < 0 or length < 0 or start + length > len(buffer):
        raise ValueError(f"buffer {view['buffer']} has {len(buffer)} bytes, and {start + length} are wanted of it")
    return buffer[start : start + length]


def without_extensions(thing: Json, names: Collection[str]) -> Json:
    """A copy that neither has nor lists the extensions; lists and mappings that become empty are dropped."""
    kept = dict(thing)
    for key in ("extensions", "extensionsUsed", "extensionsRequired"):
        if key in thing and any(name in thing[key] for name in names):
            kept[key] = _without(thing[key], names)
            if not kept[key]:
                del kept[key]
    return kept


def _without(names: Any, dropped: Collection[str]) -> Any:
    if isinstance(names, dict):
        return {name: value for name, value in names.items() if name not in dropped}
    return [name for name in names if name not in dropped]
