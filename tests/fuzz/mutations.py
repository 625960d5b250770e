"""Damages to files: of bytes, and of the JSON, YAML or text in them; each drawn from a generator of random numbers."""

from __future__ import annotations

import struct
import zipfile
import zlib
from collections.abc import Callable, Sequence
from contextlib import suppress
from io import BytesIO
from random import Random
from typing import Any

import yaml

from tests.fuzz.trees import OPENED

ODD: Sequence[Any] = (
    *(None, True, False, 0, 1, -1, 2, 3, 255, 65_536, 2**31, -(2**31), 2**53, 2**63, 10**30, 10**400),
    *(0.5, -0.5, 1e-300, 1e38, 1e300, float("nan"), float("inf"), -float("inf")),
    *("", "a", "\x1b[31mred", "\u202e", "\ud800", "x" * 5000, "../../etc/passwd", "/dev/zero", "nan", "1e400"),
    *([], {}, [[]], [None], [0, 0, 0], [1] * 17, {"a": {}}, [["a"]] * 3),
)
"""Values that a key did not expect."""


def damaged(data: bytes, other: bytes, suffix: str, random: Random) -> bytes:
    """The file with one to four damages; half of them are to its structure, if it has one that is known.

    Args:
        other: another file of the kind, of which a piece may be put in.
    """
    for _ in range(random.choice((1, 1, 1, 2, 4))):
        structured = _STRUCTURED.get(suffix)
        if structured is not None and random.random() < 0.7:
            data = structured(data, random)
        else:
            data = random.choice(_OF_BYTES)(data, other, random)
    return data


def _cut(data: bytes, other: bytes, random: Random) -> bytes:
    return data[: random.randrange(len(data) + 1)]


def _flip(data: bytes, other: bytes, random: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(random.choice((1, 4, 32))):
        if changed:
            place = random.randrange(min(len(changed), random.choice((64, 1024, len(changed)))))
            changed[place] = random.choice((0, 1, 0x7F, 0x80, 0xFF, random.randrange(256)))
    return bytes(changed)


def _number(data: bytes, other: bytes, random: Random) -> bytes:
    """Four bytes that become a number from the border of what fits there."""
    if len(data) < 8:
        return data
    place = random.randrange(min(len(data), random.choice((64, len(data)))) - 3)
    value = random.choice((0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 0x7FC00000, 0x7F800000, 65_536, 10**8))
    return data[:place] + struct.pack(random.choice("<>") + "I", value) + data[place + 4 :]


def _splice(data: bytes, other: bytes, random: Random) -> bytes:
    start, place = random.randrange(len(other) + 1), random.randrange(len(data) + 1)
    piece = other[start : start + random.choice((4, 64, 4096))]
    return data[:place] + piece + data[place + random.choice((0, len(piece))) :]


def _repeat(data: bytes, other: bytes, random: Random) -> bytes:
    start = random.randrange(len(data) + 1)
    piece = data[start : start + random.choice((1, 16, 256))]
    return data[:start] + piece * random.choice((2, 8, 200)) + data[start:]


_OF_BYTES: Sequence[Callable[[bytes, bytes, Random], bytes]] = (_cut, _flip, _flip, _number, _splice, _repeat)


def places(value: Any) -> list[tuple[Any, Any]]:
    """Each container within a value and a key of it."""
    found: list[tuple[Any, Any]] = []
    pending = [value]
    while pending:
        each = pending.pop()
        if isinstance(each, dict | list):
            found += [(each, key) for key in (each if isinstance(each, dict) else range(len(each)))]
            pending += each.values() if isinstance(each, dict) else each
    return found


def changed_tree(tree: Any, random: Random) -> Any:
    """A tree of JSON in which one value is odd, missing, doubled, scaled, moved, or nested very deeply."""
    there = places(tree)
    if not there:
        return random.choice(ODD)
    container, key = random.choice(there)
    kind = random.randrange(9)
    if kind <= 3:
        container[key] = random.choice(ODD)
    elif kind == 4:
        del container[key]
    elif kind == 5 and isinstance(container, dict):
        container[random.choice((f"{key}s", "", "extras", "\x1b"))] = container[key]
    elif kind == 5:
        container += [container[key]] * random.choice((1, 10, 2000))
    elif kind == 6 and isinstance(container[key], int | float):
        with suppress(OverflowError):  # a whole number beyond floats
            container[key] *= random.choice((-1, 2, 1000, 10**6, 0.5))
    elif kind == 7:
        others, name = random.choice(there)
        container[key] = others[name] if not isinstance(others[name], dict | list) else len(others)
    else:
        deep: Any = 0
        for _ in range(random.choice((10, 200, 800))):
            deep = [deep] if random.random() < 0.5 else {"a": deep}
        container[key] = deep
    return tree


def _tree(suffix: str) -> Callable[[bytes, Random], bytes]:
    """Changes the tree of JSON in files with this suffix."""

    def change(data: bytes, random: Random) -> bytes:
        try:
            tree, pack = OPENED[suffix](data)
            return pack(changed_tree(tree, random))
        except (yaml.YAMLError, ValueError, RecursionError, AttributeError, TypeError):
            return data

    return change


_json = _tree(".json")


def _lines(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    place = random.randrange(len(lines))
    lines[place] = _json(lines[place], random) if random.random() < 0.8 else b"1e999 nan -1"
    return b"\n".join(lines)


def _safetensors(data: bytes, random: Random) -> bytes:
    try:
        tree, pack = OPENED[".safetensors"](data)
        words = tree.get("__metadata__", {})
        name = random.choice([*words, ""])
        if name and random.random() < 0.5:  # records in words are JSON themselves
            words[name] = _json(words[name].encode(), random).decode("utf-8", "replace")
        else:
            tree = changed_tree(tree, random)
        return pack(tree)
    except (ValueError, AttributeError, TypeError, RecursionError):
        return data


def _png(data: bytes, random: Random) -> bytes:
    """One chunk damaged, with its checksum made right again; pixels are damaged before they are compressed."""
    place, chunks = 8, []
    while place + 12 <= len(data):
        (size,) = struct.unpack(">I", data[place : place + 4])
        chunks.append([data[place + 4 : place + 8], data[place + 8 : place + 8 + size]])
        place += 12 + size
    if not chunks:
        return data
    chunk = random.choice(chunks)
    try:
        pixels = zlib.decompress(chunk[1]) if chunk[0] == b"IDAT" else chunk[1]
    except zlib.error:
        pixels = chunk[1]
    pixels = random.choice(_OF_BYTES)(pixels, pixels, random)
    chunk[1] = zlib.compress(pixels) if chunk[0] == b"IDAT" else pixels
    if random.random() < 0.2:
        chunks.insert(random.randrange(len(chunks)), list(random.choice(chunks)))
    packed = (struct.pack(">I", len(d)) + kind + d + struct.pack(">I", zlib.crc32(kind + d)) for kind, d in chunks)
    return data[:8] + b"".join(packed)


def _npz(data: bytes, random: Random) -> bytes:
    """One array damaged, left out or renamed, with the archive's checksums made right again."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            arrays = {name: archive.read(name) for name in archive.namelist()}
    except (zipfile.BadZipFile, NotImplementedError, OSError, EOFError, ValueError, RuntimeError, struct.error):
        return data
    if not arrays:
        return data
    name, other = random.choice(sorted(arrays)), random.choice(sorted(arrays))
    kind = random.randrange(5)
    if kind == 0:
        del arrays[name]
    elif kind == 1:
        arrays[name] = arrays[other]
    else:
        arrays[name] = random.choice(_OF_BYTES)(arrays[name], arrays[other], random)
    stream = BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for each, content in arrays.items():
            archive.writestr(zipfile.ZipInfo(each), content)
    return stream.getvalue()


_WORDS = (
    b"nan",
    b"inf",
    b"1e308",
    b"-1",
    b"0",
    b"99999999999",
    b"",
    b"a" * 3000,
    b"\xff",
    b"1/2/3",
    b"/",
    b"-5//",
    b"\0",
)


def _words(data: bytes, random: Random) -> bytes:
    """Text of lines of words, such as OBJ and the heads of PLY."""
    lines = data.split(b"\n")
    place = random.randrange(min(len(lines), random.choice((16, len(lines)))))
    words = lines[place].split(b" ")
    words[random.randrange(len(words))] = random.choice(_WORDS)
    lines[place] = b" ".join(words)
    return b"\n".join(lines)


_STRUCTURED: dict[str, Callable[[bytes, Random], bytes]] = {
    ".json": _json,
    ".gltf": _json,
    ".jsonl": _lines,
    ".yaml": _tree(".yaml"),
    ".glb": _tree(".glb"),
    ".safetensors": _safetensors,
    ".png": _png,
    ".npz": _npz,
    ".obj": _words,
    ".mtl": _words,
    ".ply": _words,
    ".stl": _words,
    ".txt": _words,
}
