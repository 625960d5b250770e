"""Plots of the figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from svbrdfgan.bench.programs import Figures
from svbrdfgan.bench.run import Result
from svbrdfgan.bench.table import along, milliseconds
from svbrdfgan.io.atomic import atomic_path

_TIMES = (("forward_backward", "fresh", "-"), ("stored_forward_backward", "stored", "--"))
_MEMORY = (*_TIMES, ("transport", "building", ":"))
"""Steps, their names in legends, and their line styles."""


def plot_times(path: Path, results: Sequence[Result]) -> None:
    """Writes a PNG: a panel for each result, with a point for each program and kind of step, on a logarithmic scale.

    Raises:
        AssetError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    points = [_points(result) for result in results]
    heights = [0.3 * len(found) + 0.6 for found in points]
    figure = Figure(figsize=(8.0, sum(heights) + 0.5), layout="constrained")
    panels = figure.subplots(len(results), 1, squeeze=False, sharex=True, height_ratios=heights)[:, 0]
    for axes, result, found in zip(panels, results, points, strict=True):
        axes.plot(list(found.values()), list(found), "o")
        axes.invert_yaxis()
        axes.set_xscale("log")
        axes.set_title(f"{result.case.scene}, {result.case.spp} spp", loc="left")
        for name, value in found.items():
            text = milliseconds(value / 1e3)
            axes.annotate(text, (value, name), (7, 0), textcoords="offset points", va="center", fontsize=9)
        axes.margins(x=0.15, y=0.5 / len(found))
        axes.grid(alpha=0.3)
    panels[-1].set_xlabel("forward + backward, ms")
    _save(figure, path)


def plot_scaling(path: Path, axes: Mapping[str, Sequence[Result]]) -> None:
    """Writes a PNG of time and peak memory along each axis, a line for each program; all scales are logarithmic.

    Raises:
        AssetError: the file cannot be written.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.0 * len(axes), 7.0), layout="constrained")
    panels = figure.subplots(2, len(axes), squeeze=False, sharey="row", sharex="col")
    for column, (axis, results) in enumerate(axes.items()):
        times, memory = panels[:, column]
        _lines(times, axis, results, _TIMES, lambda figures, step: 1e3 * figures.seconds.get(step, 0.0))
        _lines(memory, axis, results, _MEMORY, lambda figures, step: figures.peak_bytes.get(step, 0) / 2**20)
        memory.set_xlabel("pixels along a side" if axis == "pixels" else axis)
        places = sorted({along(axis, result) for result in results})
        memory.set_xticks(places, [f"{place:,}" for place in places])
        memory.set_xticks([], minor=True)
    panels[0, 0].set_ylabel("forward + backward, ms")
    panels[1, 0].set_ylabel("peak memory, MiB")
    for row in panels:
        lines, labels = row[0].get_legend_handles_labels()
        row[-1].legend(lines, labels, loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize=9, frameon=False)
    _save(figure, path)


def _lines(
    axes: Any,
    axis: str,
    results: Sequence[Result],
    steps: Sequence[tuple[str, str, str]],
    value: Callable[[Figures, str], float],
) -> None:
    """Draws a line for each program and step. Missing or zero values have no point."""
    names = list(dict.fromkeys(figures.name for result in results for figures in result.programs))
    for number, name in enumerate(names):
        for step, kind, style in steps:
            points = [
                (along(axis, result), value(figures, step))
                for result in results
                for figures in result.programs
                if figures.name == name and value(figures, step) > 0
            ]
            if points:
                x, y = zip(*points, strict=True)
                axes.plot(x, y, style, marker="o", ms=3, color=f"C{number}", label=f"{name}, {kind}")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.grid(alpha=0.3)


def _points(result: Result) -> dict[str, float]:
    """Milliseconds, by the program's name and kind of step."""
    return {
        f"{figures.name}, {kind}": 1e3 * figures.seconds[step]
        for figures in result.programs
        for step, kind, _ in _TIMES
        if step in figures.seconds
    }


def _save(figure: Any, path: Path) -> None:
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)
