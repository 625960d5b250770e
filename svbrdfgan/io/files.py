"""Checks of paths, before files are opened."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from svbrdfgan.errors import AssetError, SvbrdfganError


def check_file(path: str | os.PathLike[str], suffixes: tuple[str, ...], what: str) -> Path:
    """The path of an existing, readable, non-empty file with one of `suffixes`.

    Args:
        what: kind of file, for error messages.

    Raises:
        AssetError: the path does not satisfy one of these conditions.
    """
    path = Path(path)
    if path.is_dir():
        raise AssetError(f"{path} is a folder; wanted a {what} file ({', '.join(suffixes)}).")
    if not path.exists():
        raise AssetError(f"{path} does not exist; wanted a {what} file ({', '.join(suffixes)}).")
    if not path.is_file():
        raise AssetError(f"{path} is not a regular file; wanted a {what} file ({', '.join(suffixes)}).")
    if path.suffix.lower() not in suffixes:
        raise AssetError(f"{path} is not a {what} file that can be read; wanted one of {', '.join(suffixes)}.")
    if not os.access(path, os.R_OK):
        raise AssetError(f"{path} may not be read; check its permissions.")
    if path.stat().st_size == 0:
        raise AssetError(f"{path} is empty; export or download it again.")
    return path


@contextmanager
def parsing(path: Path, kind: str) -> Iterator[None]:
    """Tells what a parser raises in the block as one sentence about the file.

    Args:
        kind: of file, for error messages.

    Raises:
        AssetError: the parser raised anything; parsers raise many types, and each means that the file is invalid.
    """
    try:
        yield
    except SvbrdfganError:
        raise
    except FileNotFoundError as error:
        raise AssetError(f"{path} cannot be read: {error}.") from error
    except Exception as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise AssetError(f"{path} cannot be read as {kind} ({reason}); is it whole?") from error


def require_apart(source: Path, out: Path) -> None:
    """Refuses an output path that is the input mesh.

    Raises:
        AssetError: both are the same file.
    """
    if out.exists() and source.exists() and out.samefile(source):
        raise AssetError(f"{out} is the input mesh, which the output would overwrite; choose another path.")
