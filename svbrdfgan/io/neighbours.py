"""Read the files that a mesh file names, such as materials, pictures and buffers."""

from __future__ import annotations

import logging
import mimetypes
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

log = logging.getLogger(__name__)


def as_utf8(text: bytes) -> bytes:
    """The text as UTF-8. Text that is not valid UTF-8 is read as Latin-1, which is common in old files."""
    try:
        text.decode("utf-8")
    except UnicodeDecodeError:
        return text.decode("latin-1").encode("utf-8")
    return text


@dataclass(frozen=True)
class Neighbours:
    """The files beside a mesh file; a trimesh resolver."""

    path: Path

    @property
    def file_name(self) -> str:
        return self.path.stem

    def read(self, name: str) -> bytes:
        """The bytes of a file, by its path relative to the mesh's folder, or by its file name in that folder.

        Files outside of that folder are not read, whatever the mesh names: it may come from a stranger, and what it
        names may be a device that never ends.

        Raises:
            FileNotFoundError: the file is missing or outside of the folder.
        """
        plain, folder = name.strip().replace("\\", "/"), self.path.parent.resolve()
        for candidate in (plain, unquote(plain), Path(unquote(plain)).name):
            try:
                found = (folder / candidate).resolve()
                if found.is_file() and found.is_relative_to(folder):
                    data = found.read_bytes()
                    return as_utf8(data) if candidate.lower().endswith(".mtl") else data
            except (OSError, ValueError):  # a name too long, or with a zero byte
                continue
        raise FileNotFoundError(f"the file '{name.strip()}' that it names is missing or outside of its folder")

    def get(self, name: str) -> bytes:
        """The same, with a warning for a missing file. A missing picture is empty, because the mesh loads without it.

        Raises:
            FileNotFoundError: a file that is no picture is missing.
        """
        try:
            return self.read(name)
        except FileNotFoundError:
            log.warning("%s names the file '%s', which is missing or outside of its folder", self.path, name.strip())
            if (mimetypes.guess_type(name.strip())[0] or "").startswith("image/"):
                return b""
            raise

    __getitem__ = get
