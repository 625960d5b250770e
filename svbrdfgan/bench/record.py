"""Figures and the machine as JSON values."""

from __future__ import annotations

import dataclasses
import os
import platform
from importlib import metadata
from typing import Any

import torch

from svbrdfgan import __version__
from svbrdfgan.bench.run import Result

_PACKAGES = ("torch", "numpy", "scipy", "warp-lang", "mitsuba", "drjit")


def machine() -> dict[str, Any]:
    """What figures depend on beside the code; each figure names its device itself."""
    return {
        "system": platform.platform(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "python": platform.python_version(),
        "packages": {"svbrdfgan": __version__, **dict(_versions())},
    }


def case_record(result: Result) -> dict[str, Any]:
    """One case as JSON values."""
    facts = {"vertices": result.vertices, "faces": result.faces, "embedding_s": result.embedding_s or None}
    programs = {
        kind: [dataclasses.asdict(figures) for figures in found]
        for kind, found in (("backends", result.backends), ("peers", result.peers))
    }
    return {**dataclasses.asdict(result.case), **facts, **programs}


def _versions() -> list[tuple[str, str]]:
    found = []
    for name in _PACKAGES:
        try:
            found.append((name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            continue
    return found


def _processor() -> str:
    """Its name as Linux tells it; elsewhere what Python knows."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()
