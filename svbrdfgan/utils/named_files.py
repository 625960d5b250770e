"""Files that others name: what is waited for without end, or never ends, is refused before it is read."""

from __future__ import annotations

import errno
import gc
import json
import os
import stat
from pathlib import Path
from typing import Any

MOST_TEXT = 100_000_000
"""Bytes of a text: a manifest of 10,000 pictures has 10 million."""
MOST_CONTAINERS = 3_000_000
"""Lists and objects of a JSON text; an index of 40,000 meshes, each with 64 viewpoints, has as many."""

_LONGEST_NAME = 255  # bytes, of Linux, macOS and Windows


def parse_json(text: str | bytes) -> Any:
    """The contents of a JSON text.

    Raises:
        ValueError: it is not JSON, is nested too deeply, or has more than `MOST_CONTAINERS`.
    """
    opening = ("[", "{") if isinstance(text, str) else (b"[", b"{")
    if sum(map(text.count, opening)) > MOST_CONTAINERS:  # type: ignore[arg-type]  # both are of one type
        raise ValueError(f"it has more than {MOST_CONTAINERS:,} lists and objects")
    collects = gc.isenabled()
    gc.disable()  # which looks through all that was made so far again and again, and finds nothing
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("it is nested too deeply") from error
    finally:
        if collects:
            gc.enable()


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        OSError: it cannot be read, is a pipe, a device or the like, or has more than `MOST_TEXT` bytes.
        UnicodeDecodeError: it is not UTF-8.
    """
    mode = path.stat().st_mode
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, "it is not a regular file")
    with path.open("rb") as file:
        content = file.read(MOST_TEXT + 1)  # what files of the system say of their size is not to be trusted
    if len(content) > MOST_TEXT:
        raise OSError(errno.EFBIG, f"it has more than {MOST_TEXT // 1_000_000} MB")
    return content.decode("utf-8")


def is_file_name(name: str) -> bool:
    """Whether a file can be called so, with or without folders."""
    parts = Path(name).parts
    known = bool(Path(name).name) and "\0" not in name
    return known and max(len(part.encode("utf-8", "surrogatepass")) for part in parts) <= _LONGEST_NAME


def expanded(path: str | os.PathLike[str]) -> Path:
    """The path with the folder of a user for "~"; as it is if there is no such user."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)
