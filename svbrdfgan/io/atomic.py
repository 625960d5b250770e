"""Atomic writes: a file or folder is either complete or absent."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from svbrdfgan.errors import AssetError
from svbrdfgan.utils.leftovers import temporary_name


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path next to `path`, with the same suffix.

    If the block succeeds, the temporary file replaces `path`; otherwise it is deleted. Missing parent
    folders are created.

    Raises:
        AssetError: the file cannot be written there.
    """
    target = Path(path)
    temporary = temporary_name(target)
    try:
        with writing(target):
            target.parent.mkdir(parents=True, exist_ok=True)
            yield temporary
            os.replace(temporary, target)
    finally:
        with suppress(OSError):
            temporary.unlink()


@contextmanager
def atomic_folder(target: Path) -> Iterator[Path]:
    """A temporary folder next to `target`, which it replaces if the block succeeds; otherwise it is deleted.

    Raises:
        AssetError: files cannot be written there.
    """
    with folder_beside(target) as temporary:
        yield temporary
        shutil.rmtree(target, ignore_errors=True)
        os.replace(temporary, target)


@contextmanager
def folder_beside(folder: Path) -> Iterator[Path]:
    """A temporary folder next to the final one, deleted when the block ends. Missing parent folders are created.

    Raises:
        AssetError: files cannot be written there.
    """
    stage = temporary_name(folder)
    try:
        with writing(folder):
            stage.mkdir(parents=True)
            yield stage
    finally:
        shutil.rmtree(stage, ignore_errors=True)


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Within the context, errors of the system are those of writing this file or folder.

    Raises:
        AssetError: instead of an OSError.
    """
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise AssetError(f"{path} cannot be written ({reason}); check the folder and its free space.") from error
