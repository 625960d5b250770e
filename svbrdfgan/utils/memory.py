"""How much memory there is, and how much of it may be taken."""

from __future__ import annotations

import os
from pathlib import Path

_SHARE = 0.8
"""Of the memory that is free, what may be taken by default."""
_UNKNOWN = 4 << 30
"""Bytes that count as free where the system does not say."""
_UNLIMITED = 1 << 62
_CONTAINER = Path("/sys/fs/cgroup")


def allowed_bytes(limit: int | None = None) -> int:
    """What may be taken: the limit, or a share of what is free."""
    return round(_SHARE * free_bytes()) if limit is None else limit


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
