"""CPU count and PYTHONPATH for child processes."""

from __future__ import annotations

import os
import sys


def cores() -> int:
    """The CPU cores that this process may use, where the system says; else all of them."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def import_path() -> str:
    """The `PYTHONPATH` with which a child process, started with `-P`, can import what this process can."""
    return os.pathsep.join(folder or os.getcwd() for folder in sys.path)
