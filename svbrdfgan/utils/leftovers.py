"""Temporary files and folders, whose names say which process made them, so that a later one removes what is left."""

from __future__ import annotations

import os
import platform
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path

_MADE_BY = re.compile(r"\..+\.(\d+)-([0-9a-f]{4})[0-9a-f]{8}(\.[^.]+)?")
_SCRATCH = "svbrdfgan"


def temporary_name(target: Path) -> Path:
    """A new hidden name beside the target, with its suffix.

    The first name that a process asks for in a folder removes what processes of this machine that were killed left
    there under such names.
    """
    _tidy_once(target.parent)
    made_by = f"{os.getpid()}-{_machine()}{secrets.token_hex(4)}"
    return target.with_name(f".{target.stem}.{made_by}{target.suffix}")


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """A folder among the system's temporary ones, deleted when the block ends."""
    place = Path(tempfile.gettempdir())
    folder = temporary_name(place / _SCRATCH)
    folder.mkdir(mode=0o700)
    try:
        yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


@cache
def _tidy_once(folder: Path) -> None:
    remove_leftovers(folder)


def remove_leftovers(folder: Path, *, of_all_machines: bool = False) -> None:
    """Removes what processes that have ended left in a folder under temporary names.

    Args:
        of_all_machines: takes processes of other machines for ended: nobody else may write there.
    """
    with suppress(OSError):
        for entry in list(os.scandir(folder)):
            made_by = _MADE_BY.fullmatch(entry.name)
            if made_by is None or not (_has_ended(made_by) or (of_all_machines and made_by[2] != _machine())):
                continue
            if entry.is_dir(follow_symlinks=False):
                shutil.rmtree(entry.path, ignore_errors=True)
            else:
                with suppress(OSError):
                    os.unlink(entry.path)


def _has_ended(made_by: re.Match[str]) -> bool:
    return made_by[2] == _machine() and not _is_running(int(made_by[1]))


@cache
def _machine() -> str:
    """Tells machines and containers apart, whose processes may have equal numbers."""
    return sha256(platform.node().encode()).hexdigest()[:4]


def _is_running(pid: int) -> bool:
    if os.name != "posix":  # where signal 0 would end it
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return True
