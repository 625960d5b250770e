"""Read the bytes of mesh files for a parser: detect truncated files, and convert text to UTF-8."""

from __future__ import annotations

import struct
from io import BytesIO
from pathlib import Path

from svbrdfgan.errors import AssetError
from svbrdfgan.io.neighbours import as_utf8


def open_mesh(path: Path) -> BytesIO:
    """The file's content. OBJ and ASCII STL are converted to UTF-8.

    Raises:
        AssetError: an OBJ file is not text, or an STL file is truncated.
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


def _is_binary_stl(path: Path, data: bytes) -> bool:
    """Whether an STL file is binary.

    The size decides first, because the header of a binary file may also begin with "solid".
    """
    # binary STL: 80 bytes of header, a uint32 face count, 50 bytes per face
    wanted = 84 + 50 * struct.unpack("<I", data[80:84])[0] if len(data) >= 84 else 84
    if len(data) == wanted:
        return True
    if data.lstrip().startswith(b"solid") and b"facet" in data:
        return False
    if len(data) < wanted:
        raise AssetError(f"{path} is cut short or not STL: it has {len(data)} of {wanted} bytes.")
    return True
