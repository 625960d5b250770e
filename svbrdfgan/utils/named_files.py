"""Files that others name: what is waited for without end, or never ends, is refused before it is read."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

MOST_TEXT = 100_000_000
"""Bytes of a text: a manifest of 10,000 pictures has 10 million."""


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


def expanded(path: str | os.PathLike[str]) -> Path:
    """The path with the folder of a user for "~"; as it is if there is no such user."""
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)
