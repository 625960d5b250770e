"""Every value of every record, in turn, replaced by everything odd: what random damage meets only by chance."""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml

from tests.fuzz.fuzz import Result, judged
from tests.fuzz.judge import Judge
from tests.fuzz.kinds import Kind
from tests.fuzz.mutations import ODD, packed_glb, places

_LONG = 100
"""Letters of text that is too long to be put everywhere."""


def sweep(kinds: Mapping[str, Kind], out: Path) -> Result:
    """Reads all such files of the kinds that hold JSON or YAML, and keeps failures in `out`, as `fuzz` does."""
    result, judge = Result(), Judge({name: kind.read for name, kind in kinds.items()})
    try:
        for name, kind in kinds.items():
            for data in _each(kind.seeds[0], kind.suffix):
                judged(judge, result, out, name, kind, data)
    finally:
        judge.close()
    return result


def _each(data: bytes, suffix: str) -> Iterator[bytes]:
    """The file with another value in one place, for each place and value; none if it holds no tree."""
    if suffix not in _OPENED:
        return
    tree, pack = _OPENED[suffix](data)
    for number in range(len(places(tree))):
        for value in ODD:
            if isinstance(value, str) and len(value) > _LONG:
                continue
            changed = copy.deepcopy(tree)
            container, key = places(changed)[number]
            container[key] = copy.deepcopy(value)
            yield pack(changed)


_Opened = tuple[Any, Callable[[Any], bytes]]
"""A tree of JSON, and what packs another in its place."""


def _text(tree: Any) -> bytes:
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def _json(data: bytes) -> _Opened:
    return json.loads(data), _text


def _yaml(data: bytes) -> _Opened:
    return yaml.safe_load(data), _text  # which is YAML, too


def _glb(data: bytes) -> _Opened:
    end = 20 + int.from_bytes(data[12:16], "little")
    return json.loads(data[20:end]), lambda tree: packed_glb(_text(tree), data[end:])


def _safetensors(data: bytes) -> _Opened:
    end = 8 + int.from_bytes(data[:8], "little")

    def pack(tree: Any) -> bytes:
        text = _text(tree)
        return struct.pack("<Q", len(text)) + text + data[end:]

    return json.loads(data[8:end]), pack


_OPENED: Mapping[str, Callable[[bytes], _Opened]] = {
    ".json": _json,
    ".gltf": _json,
    ".yaml": _yaml,
    ".glb": _glb,
    ".safetensors": _safetensors,
}
