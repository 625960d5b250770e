"""What a run leaves: tables, a file of figures, plots."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from svbrdfgan.bench.cases import Case
from svbrdfgan.bench.plots import plot_scaling, plot_times
from svbrdfgan.bench.record import case_record, machine
from svbrdfgan.bench.run import Result
from svbrdfgan.bench.table import Grid, axis_grid, case_grid
from svbrdfgan.io.atomic import atomic_path

FORMAT = "svbrdfgan bench 1"


@dataclass
class Report:
    """The results that there are so far, and how they are shown.

    Attributes:
        cases: those with a table of their own; the axes cross in the first.
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

    def grids(self) -> list[Grid]:
        """A table for each case, then one for each axis; once everything is measured."""
        centre = self.results[self.cases[0]]
        return [
            *(case_grid(self.results[case]) for case in self.cases),
            *(axis_grid(axis, results, centre) for axis, results in self._axes().items()),
        ]

    def write_figures(self, folder: Path) -> None:
        """`figures.json` with what there is so far; "scaling" lists places in its "cases".

        Raises:
            AssetError: the disk refuses.
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
        """`table.md`, `times.png` and, where axes were measured, `scaling.png`.

        Raises:
            AssetError: the disk refuses.
        """
        with atomic_path(folder / "table.md") as temporary:
            temporary.write_text("\n".join(grid.markdown() for grid in self.grids()), encoding="utf-8")
        plot_times(folder / "times.png", [self.results[case] for case in self.cases])
        if self.scaling:
            plot_scaling(folder / "scaling.png", self._axes())

    def _axes(self) -> dict[str, list[Result]]:
        return {axis: [self.results[case] for case in cases] for axis, cases in self.scaling.items()}
