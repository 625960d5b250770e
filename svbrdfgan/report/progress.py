"""The curves of a run, from its journal."""

from __future__ import annotations

from svbrdfgan.evaluation.record import Evaluation
from svbrdfgan.report.curves import INK, SERIES, Chart, Curve, Level
from svbrdfgan.report.facts import MetricsLog
from svbrdfgan.training.config import TrainConfig

_IMAGES = "images seen"


def charts(journal: MetricsLog, evaluation: Evaluation, config: TrainConfig) -> list[Chart]:
    """Those that the journal has numbers for."""
    shown = config.images_per_step
    made = [
        _recovered(journal, evaluation, shown),
        _lines("Losses", {"g_loss": "generator", "d_loss": "discriminator"}, journal, shown),
        _lines("Discriminator accuracy", {"d_accuracy": "pairs told apart"}, journal, shown, (0.0, 1.03)),
        _lines("Images per second", {"images_per_second": "images per second"}, journal, shown, (0.0, None)),
    ]
    return [chart for chart in made if chart is not None]


def _recovered(journal: MetricsLog, evaluation: Evaluation, shown: int) -> Chart | None:
    scored = [line for line in journal if "recovered" in line]
    if not scored:
        return None
    x, y = [line["step"] * shown for line in scored], [line["recovered"] for line in scored]
    levels = [Level(f"model on {evaluation.split}", evaluation.recovered, SERIES[1], x[y.index(max(y))])]
    if evaluation.oracle is not None:
        levels.append(Level(f"oracle on {evaluation.split}", evaluation.oracle, INK))
    least = max(-0.25, min(y)) if max(y) > 0 else min(y)  # a bad beginning is cut off, a bad run is shown
    low = min(0.0, least - 0.03, evaluation.recovered - 0.03)
    return Chart(
        title="Recovered",
        x_label=_IMAGES,
        curves=(Curve("validation", x, y),),
        levels=tuple(levels),
        limits=(low, 1.0),
        steps_per_x=1 / shown,
        size=(11.0, 3.8),
    )


def _lines(
    title: str,
    names: dict[str, str],
    journal: MetricsLog,
    shown: int,
    limits: tuple[float | None, float | None] = (None, None),
) -> Chart | None:
    curves = []
    for (key, name), color in zip(names.items(), SERIES, strict=False):
        found = [line for line in journal if key in line]
        if found:
            x, y = [line["step"] * shown for line in found], [line[key] for line in found]
            curves.append(Curve(name, x, y, color, smooth=True))
    return Chart(title, _IMAGES, tuple(curves), limits=limits, size=(4.4, 2.9)) if curves else None
