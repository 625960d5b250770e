"""Trees of JSON in files: what is taken out, changed, and packed again."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping
from typing import Any

import yaml

Opened = tuple[Any, Callable[[Any], bytes]]
"""A tree, and what makes the file with another in its place."""


def packed_glb(text: bytes, rest: bytes) -> bytes:
    """A GLB of the text of a header and of all chunks that follow."""
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A) + text + rest


def packed_json(tree: Any) -> bytes:
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def _json(data: bytes) -> Opened:
    return json.loads(data), packed_json


def _yaml(data: bytes) -> Opened:
    return yaml.safe_load(data), lambda tree: yaml.safe_dump(tree, allow_unicode=True).encode("utf-8", "surrogatepass")


def _glb(data: bytes) -> Opened:
    end = 20 + int.from_bytes(data[12:16], "little")
    return json.loads(data[20:end]), lambda tree: packed_glb(packed_json(tree), data[end:])


def _safetensors(data: bytes) -> Opened:
    end = 8 + int.from_bytes(data[:8], "little")

    def pack(tree: Any) -> bytes:
        text = packed_json(tree)
        return struct.pack("<Q", len(text)) + text + data[end:]

    return json.loads(data[8:end]), pack


OPENED: Mapping[str, Callable[[bytes], Opened]] = {
    ".json": _json,
    ".gltf": _json,
    ".yaml": _yaml,
    ".glb": _glb,
    ".safetensors": _safetensors,
}
"""By the suffix of a file; each raises ValueError or a YAMLError for what is no tree."""
