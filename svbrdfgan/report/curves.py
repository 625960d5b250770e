"""Curves of a training run as SVG, drawn in the colours and type of the page that they stand in."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from io import StringIO
from typing import Any

_STAND_INS = {
    "#010203": "var(--ink-soft)",
    "#010204": "var(--line)",
    "#010205": "var(--series-1)",
    "#010206": "var(--series-2)",
    "#010207": "var(--series-3)",
    "#010208": "var(--series-4)",
}
"""Colours that matplotlib writes, and the page's own that replace them."""

INK, LINE, *SERIES = _STAND_INS
_FEW = 12
_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 10,
    "axes.edgecolor": LINE,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "grid.color": LINE,
    "grid.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.spines.left": False,
    "legend.frameon": False,
    "path.simplify": True,
}


@dataclass(frozen=True)
class Curve:
    """A line of a chart; `smooth` draws its running mean over the faint line itself."""

    name: str
    x: Sequence[float]
    y: Sequence[float]
    color: str = SERIES[0]
    smooth: bool = False


@dataclass(frozen=True)
class Level:
    """A horizontal line, or a single point at `x`."""

    name: str
    y: float
    color: str
    x: float | None = None


@dataclass(frozen=True)
class Chart:
    """What to draw.

    Attributes:
        steps_per_x: steps of training in one unit of x, for a second axis; None for no such axis.
    """

    title: str
    x_label: str
    curves: tuple[Curve, ...]
    levels: tuple[Level, ...] = field(default=())
    limits: tuple[float | None, float | None] = (None, None)
    steps_per_x: float | None = None
    size: tuple[float, float] = (5.4, 2.9)


def draw(chart: Chart) -> str:
    """The chart as an SVG element for HTML, without its title. matplotlib's global state stays as it was."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context({**_STYLE, "svg.hashsalt": chart.title}):
        figure = Figure(figsize=chart.size, layout="constrained")
        figure.patch.set_visible(False)
        axes = figure.add_subplot()
        axes.patch.set_visible(False)
        _plot(axes, chart)
        stream = StringIO()
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return _for_page(stream.getvalue(), chart.title)


def _plot(axes: Any, chart: Chart) -> None:
    from matplotlib.ticker import MaxNLocator

    for curve in chart.curves:
        _plot_curve(axes, curve)
    for level in chart.levels:
        _plot_level(axes, level)
    axes.set_xlabel(chart.x_label)
    axes.xaxis.set_major_locator(MaxNLocator(4 if chart.size[0] < 6 else 8))
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.set_ylim(*chart.limits)
    axes.grid(axis="y")
    axes.tick_params(length=0)
    if len(chart.curves) + len(chart.levels) > 1:
        axes.legend(loc="best", fontsize=9, handlelength=1.6)
    if chart.steps_per_x is not None:
        _add_steps(axes, chart.steps_per_x)


def _plot_curve(axes: Any, curve: Curve) -> None:
    style = {"color": curve.color, "lw": 1.6}
    if len(curve.y) < _FEW:
        axes.plot(curve.x, curve.y, marker="o", ms=3, label=curve.name, **style)
    elif curve.smooth:
        axes.plot(curve.x, curve.y, alpha=0.25, **style)
        axes.plot(curve.x, _running_mean(curve.y), label=curve.name, **style)
    else:
        axes.plot(curve.x, curve.y, label=curve.name, **style)


def _plot_level(axes: Any, level: Level) -> None:
    if level.x is None:
        axes.axhline(level.y, color=level.color, lw=1.3, ls=(0, (5, 3)), label=level.name)
    else:
        axes.plot([level.x], [level.y], "D", color=level.color, ms=6, label=level.name, zorder=5)


def _add_steps(axes: Any, per_x: float) -> None:
    top = axes.secondary_xaxis("top", functions=(lambda x: x * per_x, lambda steps: steps / per_x))
    top.set_xlabel("steps")
    top.xaxis.set_major_formatter("{x:,.0f}")
    top.tick_params(length=0)
    top.spines["top"].set_visible(False)


def _running_mean(values: Sequence[float]) -> list[float]:
    """The mean over a tenth of all values about each."""
    reach = max(1, len(values) // 20)
    windows = [values[max(0, n - reach) : n + reach + 1] for n in range(len(values))]
    return [sum(window) / len(window) for window in windows]


def _for_page(svg: str, title: str) -> str:
    """The SVG element alone, without fixed size, metadata or fonts, its colours the page's."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    svg = re.sub(r"font: ([\d.]+px) [^;\"]+", r"font-size: \1; font-family: inherit", svg)
    for stand_in, color in _STAND_INS.items():
        svg = svg.replace(stand_in, color)
    name = title.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return svg.replace("<svg ", f'<svg role="img" aria-label="{name}" ', 1)
