"""The output of a run: tables, a JSON file of figures, plots."""

from __future__ import annotations

import dataclasses
import json
import os
import platform
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import torch

from svbrdfgan import __version__
from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.plots import plot_scaling, plot_times
from svbrdfgan.bench.run import Result
from svbrdfgan.bench.table import TextTable, axis_table, case_table
from svbrdfgan.io.atomic import atomic_path

FORMAT = "svbrdfgan bench 1"
_PACKAGES = ("torch", "numpy", "scipy", "warp-lang", "mitsuba", "drjit")


def machine() -> dict[str, Any]:
    """The system and versions that figures depend on. Each figure names its device itself."""
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
    """The processor's name from /proc, which Linux has; elsewhere from Python."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8") as lines:
            return next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor()


@dataclass
class Report:
    """The results so far, and their tables and files.

    Attributes:
        cases: those with their own table; the axes run through the first.
        scaling: the cases along each axis, in ascending order.
    """

    cases: tuple[Case, ...]
    scaling: Mapping[str, tuple[Case, ...]]
    repeats: int
    results: dict[Case, Result] = field(default_factory=dict)
    machine: Mapping[str, Any] = field(default_factory=machine)

    def all_cases(self) -> tuple[Case, ...]:
        """Everything to measure, in order, each once."""
        return tuple(dict.fromkeys((*self.cases, *(case for cases in self.scaling.values() for case in cases))))

    def tables(self) -> list[TextTable]:
        """A table for each case, then one for each axis. All must have been measured."""
        centre = self.results[self.cases[0]]
        return [
            *(case_table(self.results[case]) for case in self.cases),
            *(axis_table(axis, results, centre) for axis, results in self._axes().items()),
        ]

    def write_figures(self, folder: Path) -> None:
        """Writes `figures.json` with the results so far; "scaling" lists indices into "cases".

        Raises:
            AssetError: a file cannot be written.
        """
        places = {case: place for place, case in enumerate(self.results)}
        record = {
            "format": FORMAT,
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "machine": self.machine,
            "repeats": self.repeats,
            "cases": [case_record(result) for result in self.results.values()],
            "scaling": {axis: [places[c] for c in cases if c in places] for axis, cases in self.scaling.items()},
        }
        with atomic_path(folder / "figures.json") as temporary:
            temporary.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")

    def write_tables_and_plots(self, folder: Path) -> None:
        """Writes `table.md`, `times.png` and, if axes were measured, `scaling.png`.

        Raises:
            AssetError: a file cannot be written.
        """
        with atomic_path(folder / "table.md") as temporary:
            temporary.write_text("\n".join(table.markdown() for table in self.tables()), encoding="utf-8")
        plot_times(folder / "times.png", [self.results[case] for case in self.cases])
        if self.scaling:
            plot_scaling(folder / "scaling.png", self._axes())

    def _axes(self) -> dict[str, list[Result]]:
        return {axis: [self.results[case] for case in cases] for axis, cases in self.scaling.items()}
