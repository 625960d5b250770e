"""How much memory there is, how much of it may be taken, and the refusal of what needs more."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from svbrdfgan.errors import ConfigError, SvbrdfganError

PROGRAM = 460 << 20
"""Bytes of the interpreter with NumPy and torch: their libraries, and what these take when they are first used."""

_SHARE = 0.8
"""Of the memory that is free, what may be taken by default."""
_UNKNOWN = 4 << 30
"""Bytes that count as free where the system does not say."""
_UNLIMITED = 1 << 62
_CONTAINER = Path("/sys/fs/cgroup")
_limits: list[int | None] = [None]
"""Those of the blocks of `limited` that are open; the last one counts."""


@contextmanager
def limited(limit: int | None) -> Iterator[None]:
    """For the time of the block this process may hold that many bytes; None allows a share of what is free."""
    _limits.append(limit)
    try:
        yield
    finally:
        _limits.pop()


def allowed_bytes() -> int:
    """What the process may hold: the limit that was set, or a share of what is free."""
    limit = _limits[-1]
    return round(_SHARE * free_bytes()) if limit is None else limit


def require_memory(
    needs: str,
    needed: int,
    fitting: Callable[[int], str | None] = lambda _allowed: None,
    *,
    instead: str = "allow more by --memory, or free some",
    error: type[SvbrdfganError] = ConfigError,
) -> int:
    """The bytes that something needs, if that many may be taken.

    Args:
        needs: begins the refusal, such as "a film of 9 x 9 pixels needs".
        fitting: what fits into a number of bytes, such as "--resolution 512"; None if nothing of the kind does.
        instead: what to do where nothing fits.
        error: the refusal.

    Raises:
        SvbrdfganError: fewer are allowed. One sentence says what needs how much, the limit, and what would fit.
    """
    allowed = allowed_bytes()
    if needed <= allowed:
        return needed
    fits = fitting(allowed)
    raise error(
        f"{needs} about {gigabytes(needed)} of memory and {gigabytes(allowed)} are allowed; "
        f"{f'{fits} would fit' if fits else instead}."
    )


def most_that_fits(needed: Callable[[int], int], below: int, allowed: int, multiple: int = 1) -> int | None:
    """The greatest multiple below a number whose needs are allowed; None if not even the first one's are.

    Args:
        needed: the bytes for a number, which grow with it.
    """
    low, high = 0, max(-(-below // multiple) - 1, 0)
    while low < high:
        middle = (low + high + 1) // 2
        low, high = (middle, high) if needed(multiple * middle) <= allowed else (low, middle - 1)
    return multiple * low or None


def free_bytes() -> int:
    """Memory that the process can still take: of the machine, and of a container's share of it."""
    return min(_machine_bytes(), _container_bytes())


def gigabytes(count: int) -> str:
    """A number of bytes for people."""
    return f"{count / 2**30:.1f} GiB"


def _container_bytes() -> int:
    """By Linux's control groups, version 2."""
    try:
        limit, used = ((_CONTAINER / name).read_text(encoding="ascii") for name in ("memory.max", "memory.current"))
        return int(limit) - int(used)
    except (OSError, ValueError):  # no container, or "max"
        return _UNLIMITED


def _machine_bytes() -> int:
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) << 10 for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        pass
    try:
        return os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):
        return _UNKNOWN
