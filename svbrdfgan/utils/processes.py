"""Processes of our own: how many there may be, and how they find what this one has found."""

from __future__ import annotations

import os
import sys


def cores() -> int:
    """Those that this process may use, where the system tells."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def import_path() -> str:
    """`PYTHONPATH` for a process that is to import what this one can, started with `-P`."""
    return os.pathsep.join(folder or os.getcwd() for folder in sys.path)
