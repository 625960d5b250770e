"""Atomic writes: a file or folder is either complete or absent."""

from __future__ import annotations

import os
import secrets
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from svbrdfgan.errors import AssetError


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path next to `path`, with the same suffix.

    If the block succeeds, the temporary file replaces `path`; otherwise it is deleted. Missing parent
    folders are created.

    Raises:
        AssetError: the file cannot be written there.
    """
    target = Path(path)
    temporary = target.with_name(f".{target.stem}.{os.getpid()}-{secrets.token_hex(4)}{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        reason = error.strerror or str(error)
        raise AssetError(f"{target} cannot be written ({reason}); check the folder and its free space.") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def folder_beside(folder: Path) -> Iterator[Path]:
    """A temporary folder next to the final one, deleted when the block ends. Missing parent folders are created.

    Raises:
        AssetError: files cannot be written there.
    """
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent) as stage:
            yield Path(stage)
    except OSError as error:
        raise AssetError(f"{folder} cannot be written ({error.strerror or error}); choose another place.") from error
