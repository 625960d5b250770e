"""Charts of a training run as SVG, in the colours and type of the page that contains them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from io import StringIO
from typing import Any

from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.report.facts import MetricsLog
from svbrdfgan.training.config import TrainConfig

_STAND_INS = {
    "#010203": "var(--ink-soft)",
    "#010204": "var(--line)",
    "#010205": "var(--series-1)",
    "#010206": "var(--series-2)",
    "#010207": "var(--series-3)",
    "#010208": "var(--series-4)",
}
"""Colours that matplotlib writes, and the page's CSS variables that replace them."""

INK, LINE, *SERIES = _STAND_INS
_FEW = 12
"""The number of values below which they are drawn as points."""
_IMAGES = "images seen"
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
    """A line of a chart; with `smooth`, its running mean is drawn over a faint line."""

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
class LineChart:
    """A chart to draw.

    Attributes:
        steps_per_x: training steps in one unit of x, for a second axis; None for no second axis.
    """

    title: str
    x_label: str
    curves: tuple[Curve, ...]
    levels: tuple[Level, ...] = field(default=())
    limits: tuple[float | None, float | None] = (None, None)
    steps_per_x: float | None = None
    size: tuple[float, float] = (5.4, 2.9)


def charts(log: MetricsLog, evaluation: Evaluation, config: TrainConfig) -> list[LineChart]:
    """The charts for which the log has numbers."""
    images_per_step = config.images_per_step
    made = [
        _scores(log, evaluation, images_per_step),
        _lines("Losses", {"g_loss": "generator", "d_loss": "discriminator"}, log, images_per_step),
        _lines("Discriminator accuracy", {"d_accuracy": "pairs distinguished"}, log, images_per_step, (0.0, 1.03)),
        _lines("Images per second", {"images_per_second": "images per second"}, log, images_per_step, (0.0, None)),
    ]
    return [chart for chart in made if chart is not None]


def _scores(log: MetricsLog, evaluation: Evaluation, images_per_step: int) -> LineChart | None:
    """The validation scores by which training kept its best generator, and the scores of the report's own split."""
    measure = "resemblance" if evaluation.of_distribution else "recovered"
    scored = [line for line in log if measure in line]
    if not scored:
        return None
    x, y = [line["step"] * images_per_step for line in scored], [line[measure] for line in scored]
    final = getattr(evaluation.generated, measure)
    levels = [] if final is None else [Level(f"model on {evaluation.split}", final, SERIES[1], x[y.index(max(y))])]
    best = None if evaluation.oracle is None else getattr(evaluation.oracle, measure)
    if best is not None:
        levels.append(Level(f"oracle on {evaluation.split}", best, INK))
    least = max(-0.25, min(y)) if max(y) > 0 else min(y)  # cuts off a bad start, but not a run that is bad throughout
    low = min([0.0, least - 0.03] + [level.y - 0.03 for level in levels])
    return LineChart(
        title=measure.capitalize(),
        x_label=_IMAGES,
        curves=(Curve("validation", x, y),),
        levels=tuple(levels),
        limits=(low, 1.0),
        steps_per_x=1 / images_per_step,
        size=(11.0, 3.8),
    )


def _lines(
    title: str,
    names: dict[str, str],
    log: MetricsLog,
    images_per_step: int,
    limits: tuple[float | None, float | None] = (None, None),
) -> LineChart | None:
    curves = []
    for (key, name), color in zip(names.items(), SERIES, strict=False):
        found = [line for line in log if key in line]
        if found:
            x, y = [line["step"] * images_per_step for line in found], [line[key] for line in found]
            curves.append(Curve(name, x, y, color, smooth=True))
    return LineChart(title, _IMAGES, tuple(curves), limits=limits, size=(4.4, 2.9)) if curves else None


def draw(chart: LineChart) -> str:
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


def _plot(axes: Any, chart: LineChart) -> None:
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
    """The mean over a tenth of all values, around each value."""
    reach = max(1, len(values) // 20)
    windows = [values[max(0, n - reach) : n + reach + 1] for n in range(len(values))]
    return [sum(window) / len(window) for window in windows]


def _for_page(svg: str, title: str) -> str:
    """The SVG element alone, without fixed size, metadata and fonts, in the page's colours."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r' (width|height)="[\d.]+pt"', "", svg, count=2)
    svg = re.sub(r"font: ([\d.]+px) [^;\"]+", r"font-size: \1; font-family: inherit", svg)
    for stand_in, color in _STAND_INS.items():
        svg = svg.replace(stand_in, color)
    name = title.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return svg.replace("<svg ", f'<svg role="img" aria-label="{name}" ', 1)
