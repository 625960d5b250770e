"""The bytes of mesh files, made safe for a parser: whole, and text in an encoding that it knows."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

from svbrdfgan.errors import AssetError


def open_mesh(path: Path) -> BytesIO:
    """The file's content; OBJ and ASCII STL as UTF-8.

    Raises:
        AssetError: an OBJ that is not text, or an STL that is cut short.
    """
    data = path.read_bytes()
    kind = path.suffix.lower()
    if kind == ".obj":
        if b"\0" in data:
            raise AssetError(f"{path} is not an OBJ file: it holds binary data.")
        data = as_utf8(data)
    if kind == ".stl" and not _is_binary_stl(path, data):
        data = as_utf8(data)
    return BytesIO(data)


def as_utf8(text: bytes) -> bytes:
    """Text as UTF-8: unchanged if it is, else taken for Latin-1, as names and comments in old files are."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1").encode("utf-8")
    return text


def _is_binary_stl(path: Path, data: bytes) -> bool:
    """Whether an STL file is binary. An ASCII one begins with "solid" and has a facet; so may a binary one's head."""
    wanted = 84 + 50 * struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 84
    if len(data) == wanted:
        return True
    if data.lstrip().startswith(b"solid") and b"facet" in data:
        return False
    if len(data) < wanted:
        raise AssetError(f"{path} is cut short or not STL: it has {len(data)} of {wanted} bytes.")
    return True
