"""Read and write glTF files as whole documents: the JSON as it is, and the bytes that it refers to.

The JSON stays a dictionary. A typed model of glTF, such as pygltflib's, drops what it does not know (extras, names of
buffers, extensions of nodes) and writes defaults that the file did not state.
"""

from __future__ import annotations

import copy
import json
import mimetypes
import os
import struct
from base64 import b64decode
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.files import check_file, parsing
from svbrdfgan.io.gltf.header import check_header
from svbrdfgan.io.gltf_codecs.plain import Json
from svbrdfgan.io.neighbours import Neighbours
from svbrdfgan.utils.named_files import parse_json

SUFFIXES = (".glb", ".gltf")
_ALIGNMENT = 4  # of accessors and chunks, as glTF demands it
_CHUNK_HEAD = 8
_GLB_HEAD = 12


@dataclass(eq=False)
class Document:
    """A glTF file in memory, to be edited in place.

    Attributes:
        header: the file's JSON, whose `buffers` are ignored: they are made again when the document is written.
        views: the content of each of the header's `bufferViews`.
        path: the file it was read from, for messages and for the pictures beside it.
        changes: sentences about what is read in another way than it was stored, such as a lost compression.
    """

    header: Json
    views: list[bytes | memoryview]
    path: Path
    changes: list[str] = field(default_factory=list)

    def table(self, name: str) -> list[Json]:
        """The entries of one of the header's arrays, such as `materials`; an unstored, empty list if absent."""
        found: list[Json] = self.header.get(name, [])
        return found

    def add(self, name: str, entry: Json) -> int:
        """The index of a new entry of one of the header's arrays."""
        entries: list[Json] = self.header.setdefault(name, [])
        entries.append(entry)
        return len(entries) - 1

    def add_view(self, data: bytes, **keys: Any) -> int:
        """The index of a new buffer view."""
        self.views.append(data)
        return self.add("bufferViews", {"buffer": 0, "byteLength": len(data), **keys})

    def copy(self) -> Document:
        """A document that can be edited apart from this one."""
        return Document(copy.deepcopy(self.header), list(self.views), self.path, list(self.changes))


def read_document(path: str | os.PathLike[str]) -> Document:
    """The document of a .glb or .gltf file, with Draco and meshopt compression undone.

    Raises:
        AssetError: the file is missing, truncated, or not glTF 2.0, or refers to bytes that do not exist.
    """
    path = check_file(path, SUFFIXES, "glTF")
    data = path.read_bytes()
    binary = path.suffix.lower() == ".glb"
    header, chunk = _split_glb(path, data) if binary else (_json(path, data), None)
    with parsing(path, "glTF"):
        check_header(path, header)
        return _document(path, header, chunk)


def write_document(path: str | os.PathLike[str], document: Document) -> list[Path]:
    """Writes a document as one .glb file, or as .gltf with its buffer and its pictures in files beside it.

    All buffer views are packed into one buffer, so the document's other indices stay as they are.

    Returns:
        The paths written.

    Raises:
        AssetError: the suffix is neither, or a file cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise AssetError(f"{path} does not end in .glb or .gltf, the kinds of mesh file that are written.")
    edited = document.copy()
    if path.suffix.lower() == ".gltf":
        return _write_gltf(path, edited)
    _embed_pictures(edited)
    _write_glb(path, edited)
    return [path]


def picture_bytes(document: Document, image: int) -> bytes:
    """The file of one of the header's `images`, wherever it is stored.

    Raises:
        AssetError: the image names neither a buffer view nor a file, or a broken data URI.
        FileNotFoundError: its file is missing, or outside of the document's folder.
    """
    entry = document.table("images")[image]
    if "bufferView" in entry:
        return bytes(document.views[entry["bufferView"]])
    if not isinstance(entry.get("uri"), str):
        raise AssetError(f"{document.path} has an image {image} without a buffer view or a file.")
    return _resource(document.path, entry["uri"])


def picture_type(data: bytes) -> str:
    """The MIME type of a picture, by its first bytes; PNG if they tell nothing."""
    kinds = {b"\xff\xd8\xff": "image/jpeg", b"\x89PNG": "image/png", b"\xabKTX 20": "image/ktx2"}
    found = next((kind for head, kind in kinds.items() if data.startswith(head)), "image/png")
    return "image/webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else found


def drop_views(document: Document, dead: Collection[int]) -> None:
    """Removes buffer views that nothing refers to, and renumbers the others wherever a `bufferView` is named."""
    kept = [index for index in range(len(document.views)) if index not in dead]
    number = {old: new for new, old in enumerate(kept)}
    document.views = [document.views[index] for index in kept]
    document.header["bufferViews"] = [document.header["bufferViews"][index] for index in kept]
    if not kept:
        del document.header["bufferViews"]
    _renumber(document.header, number)


def _renumber(entry: Any, number: dict[int, int]) -> None:
    for key, value in entry.items() if isinstance(entry, dict) else enumerate(entry):
        if key == "bufferView" and isinstance(value, int):
            entry[key] = number[value]
        elif isinstance(value, dict | list) and key != "extras":
            _renumber(value, number)


def _document(path: Path, header: Json, chunk: memoryview | None) -> Document:
    buffers = [_buffer(path, entry, chunk if k == 0 else None) for k, entry in enumerate(header.get("buffers", []))]
    from svbrdfgan.io.gltf_codecs.decompress import decompressed  # few files need it

    before = named_views(header)
    header, plain, changes = decompressed(header, buffers, str(path))
    views: list[bytes | memoryview] = [_view(path, entry, plain) for entry in header.get("bufferViews", [])]
    document = Document(header, views, path, list(changes))
    drop_views(document, before - named_views(header))
    return document


def named_views(entry: Any) -> set[int]:
    """The buffer views that anything in a header names."""
    found: set[int] = set()
    for key, value in entry.items() if isinstance(entry, dict) else enumerate(entry):
        if key == "bufferView" and isinstance(value, int):
            found.add(value)
        elif isinstance(value, dict | list) and key != "extras":
            found |= named_views(value)
    return found


def _buffer(path: Path, entry: Json, chunk: memoryview | None) -> bytes:
    uri = entry.get("uri")
    if uri is None and chunk is None:
        return b""  # of meshopt's fallback buffers nothing is stored
    try:
        data = bytes(chunk) if uri is None and chunk is not None else _resource(path, str(uri))
    except FileNotFoundError as error:
        raise AssetError(f"{path} cannot be read: {error}.") from error
    if len(data) < entry["byteLength"]:
        raise AssetError(f"{path} is cut short: a buffer has {len(data)} of {entry['byteLength']} bytes.")
    return data


def _view(path: Path, entry: Json, buffers: list[bytes]) -> memoryview:
    start, length = int(entry.get("byteOffset", 0)), int(entry["byteLength"])
    buffer = buffers[entry["buffer"]]
    if start < 0 or length < 0 or start + length > len(buffer):
        raise AssetError(f"{path} has a buffer view of bytes {start} to {start + length} of {len(buffer)}.")
    return memoryview(buffer)[start : start + length]


def _resource(path: Path, uri: str) -> bytes:
    if not uri.startswith("data:"):
        return Neighbours(path).read(uri)
    head, _, payload = uri.partition(",")
    if not head.endswith(";base64"):
        raise AssetError(f"{path} has a data URI that is not base64: {uri[:40]}...")
    return b64decode(payload)


def _split_glb(path: Path, data: bytes) -> tuple[Json, memoryview | None]:
    if data[:4] != b"glTF":
        raise AssetError(f"{path} is not a GLB file: it does not begin with 'glTF'.")
    if len(data) < _GLB_HEAD + _CHUNK_HEAD:
        raise AssetError(f"{path} is cut short: it has {len(data)} bytes; export or download it again.")
    version, length, size = struct.unpack("<III", data[4:16])
    if version != 2:
        raise AssetError(f"{path} is glTF version {version}; wanted version 2.")
    start = _GLB_HEAD + _CHUNK_HEAD
    wanted = max(length, start + size)
    if wanted > len(data):
        raise AssetError(f"{path} is cut short: it has {len(data)} of {wanted} bytes; export or download it again.")
    header, rest = _json(path, data[start : start + size]), memoryview(data)[start + size : length]
    if len(rest) < _CHUNK_HEAD:
        return header, None
    (size,) = struct.unpack("<I", rest[:4])
    return header, rest[_CHUNK_HEAD : _CHUNK_HEAD + size]


def _json(path: Path, text: bytes) -> Json:
    try:
        header: Json = parse_json(text)
    except ValueError as error:
        raise AssetError(f"{path} cannot be read as glTF: its JSON is broken ({error}).") from error
    return header


def _embed_pictures(document: Document) -> None:
    """Moves pictures that lie in files or data URIs into buffer views. Missing files stay names."""
    for image, entry in enumerate(document.table("images")):
        if "bufferView" in entry:
            continue
        try:
            data = picture_bytes(document, image)
        except FileNotFoundError:
            continue
        del entry["uri"]
        entry["bufferView"] = document.add_view(data)
        entry.setdefault("mimeType", picture_type(data))


def _packed(document: Document) -> bytearray:
    """One buffer of all views, whose entries in the header are told where."""
    binary = bytearray()
    for entry, data in zip(document.table("bufferViews"), document.views, strict=True):
        entry |= {"buffer": 0, "byteOffset": len(binary), "byteLength": len(data)}
        binary += data
        binary += b"\0" * (-len(binary) % _ALIGNMENT)
    return binary


def _set_buffer(document: Document, binary: bytearray, **uri: str) -> None:
    if not binary:
        document.header.pop("buffers", None)
        return
    kept = {key: value for key, value in (document.table("buffers") or [{}])[0].items() if key in ("name", "extras")}
    document.header["buffers"] = [{**kept, "byteLength": len(binary), **uri}]


def _dumped(header: Json) -> bytes:
    return json.dumps(header, separators=(",", ":"), allow_nan=False).encode("ascii")  # files may name half characters


def _write_glb(path: Path, document: Document) -> None:
    binary = _packed(document)
    _set_buffer(document, binary)
    text = _dumped(document.header)
    text += b" " * (-len(text) % _ALIGNMENT)
    rest = _CHUNK_HEAD + len(binary) if binary else 0
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, _GLB_HEAD + _CHUNK_HEAD + len(text) + rest))
        file.write(struct.pack("<I4s", len(text), b"JSON") + text)
        if binary:
            file.write(struct.pack("<I4s", len(binary), b"BIN\0") + binary)


def _write_gltf(path: Path, document: Document) -> list[Path]:
    pictures: dict[str, bytes] = {}
    dead: set[int] = set()
    for image, entry in enumerate(document.table("images")):
        try:
            data = picture_bytes(document, image)
        except FileNotFoundError:
            continue
        suffix = mimetypes.guess_extension(entry.get("mimeType") or picture_type(data)) or ".bin"
        name = f"{path.stem}.{image}{suffix}"
        if "bufferView" in entry:
            dead.add(entry.pop("bufferView"))
        entry["uri"], pictures[name] = quote(name), data
    drop_views(document, dead)
    binary = _packed(document)
    _set_buffer(document, binary, uri=quote(f"{path.stem}.bin"))
    files = {path.with_name(name): data for name, data in pictures.items()}
    if binary:
        files[path.with_suffix(".bin")] = bytes(binary)
    files[path] = _dumped(document.header)  # last, so that no file names another that is not there
    for file, data in files.items():
        with atomic_path(file) as temporary:
            temporary.write_bytes(data)
    return list(files)
