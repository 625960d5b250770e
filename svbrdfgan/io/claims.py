"""One writer at a time: a process claims what it works on, and a second one is refused."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from svbrdfgan.errors import AssetError
from svbrdfgan.io.atomic import writing

_PATIENCE_SECONDS = 2.0
"""How long a process that was stopped may take to end."""
_POLL_SECONDS = 0.1


@contextmanager
def claimed_folder(folder: Path, *, shared: bool = False) -> Iterator[None]:
    """For the time of the block no other process can claim the folder. It is made, and removed if it stays empty.

    Args:
        shared: lets others share the claim: it only keeps away who wants the folder alone.

    Raises:
        AssetError: another process has claimed it, or it cannot be made.
    """
    made = [each for each in (folder, *folder.parents) if not each.exists()]
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    try:
        with claimed(folder, f"{folder} is being written by another process", shared=shared):
            yield
    finally:
        with suppress(OSError):  # it is not empty
            for each in made:
                each.rmdir()


@contextmanager
def claimed(path: Path, trouble: str, *, shared: bool = False, patience: float = _PATIENCE_SECONDS) -> Iterator[None]:
    """For the time of the block no other process can claim the file or folder.

    The claim is a lock on the file or folder itself: nothing is written, and a process that is killed leaves no lock.
    Where the system has no such locks, as on Windows and on some network drives, everyone gets the claim, and so it is
    of a path where nothing is.

    Args:
        trouble: opens the message if another process has claimed it.
        shared: lets others share the claim, as for `claimed_folder`.
        patience: seconds to wait for another process.

    Raises:
        AssetError: another process has claimed it.
    """
    handle = os.open(path, _access(path)) if os.name == "posix" and path.exists() else None
    try:
        until = time.monotonic() + patience
        while handle is not None and not _lock(handle, shared):
            if time.monotonic() > until:
                raise AssetError(f"{trouble}; wait until it has ended.")
            time.sleep(_POLL_SECONDS)
        yield
    finally:
        if handle is not None:
            os.close(handle)


def _access(path: Path) -> int:
    """How to open what is to be locked: network drives lock only files that may be written."""
    return os.O_RDWR if path.is_file() and os.access(path, os.W_OK) else os.O_RDONLY


def _lock(handle: int, shared: bool) -> bool:
    """Whether no other process holds a lock that excludes this one."""
    import fcntl

    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # no locks here
        return True
    return True
