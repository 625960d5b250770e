"""The report: an HTML page that needs no other files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from svbrdfgan.config.models import StrictModel
from svbrdfgan.evaluation.evaluated import Evaluated
from svbrdfgan.evaluation.record import of_split
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.report.curves import charts, draw
from svbrdfgan.report.draw_facts import draw_verdict, part_bars
from svbrdfgan.report.draws import COLUMNS, STRIP, amount_of, sheets, strip
from svbrdfgan.report.facts import HELD_OUT, MetricsLog, find_plan, flip_bars, relit_bars, summary, title, verdict
from svbrdfgan.report.patches import patch_maps
from svbrdfgan.report.pictures import data_uri
from svbrdfgan.report.vehicles import (
    choose_views,
    close_up,
    compared,
    drawn_textures,
    error_scale,
    rendered,
    shown,
    textured,
)
from svbrdfgan.training.metrics_log import read_metrics

REPORT = "report.html"
_VEHICLES = 6  # of which renders are shown
_TEXTURES = 3  # the first of them, of which layers are shown too
_JUDGED = 3  # and patch maps


def write_report(run: Path, evaluated: Evaluated, live: str | None = None) -> Path:
    """The path of the run's report, which it writes: `report.html`, or for splits other than test `report.SPLIT.html`.

    The page says what it leaves out because the run does not have it.

    Args:
        live: a page with a vehicle to turn about, which the report then contains (`svbrdfgan.viewer.page.baked_page`).

    Raises:
        AssetError: the page cannot be written.
    """
    page = _render({**_contents(run, evaluated), "live": live})
    path = run / of_split(REPORT, evaluated.evaluation.split)
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8")
    return path


def _contents(run: Path, evaluated: Evaluated) -> dict[str, Any]:
    config, evaluation = evaluated.config, evaluated.evaluation
    views = choose_views(evaluated.source.exemplars, _VEHICLES)
    textures = views[:_TEXTURES]
    log, plan = read_metrics(run), find_plan(config)
    drawn = charts(log, evaluation, config.train)
    return {
        "name": run.resolve().name,
        "title": title(config, plan),
        "evaluation": evaluation,
        "subjects_title": HELD_OUT[evaluation.split],
        "summary": summary(evaluated, plan, log),
        **(_of_draws(evaluated, views) if evaluation.of_distribution else _of_layers(evaluated, views, log)),
        "sheets": sheets(evaluated, textures),
        "close_ups": [close_up(scene) for scene in evaluated.close_ups],
        "sheet_columns": COLUMNS,
        "patches": patch_maps(run, evaluated, views[:_JUDGED]),
        "charts": [(chart, draw(chart)) for chart in drawn],
        "scored": any("recovered" in line for line in log),
        "versions": config.versions,
        "dataset_yaml": _yaml(config.dataset),
        "train_yaml": _yaml(config.train),
        "dataset_name": config.train.dataset,
    }


def _of_layers(evaluated: Evaluated, views: list[int], log: MetricsLog) -> dict[str, Any]:
    """What the page shows of a generator that learned one layer for each vehicle."""
    evaluation, textures = evaluated.evaluation, views[:_TEXTURES]
    top = error_scale(evaluated, textures)
    return {
        "headline": f"recovered {evaluation.generated.recovered:.3f}",
        "verdict": verdict(evaluation, evaluated.config.train, log),
        "flip_bars": flip_bars(evaluation),
        "relit_bars": relit_bars(evaluation),
        "maps": evaluation.map_table(),
        "little_observed": evaluation.little_observed(),
        "vehicles": [rendered(evaluated, index) for index in views],
        "relit": [compared(scene) for scene in evaluated.relit],
        "textures": [textured(evaluated, index, top) for index in textures],
        "error_top": f"{top:.2f}",
    }


def _of_draws(evaluated: Evaluated, views: list[int]) -> dict[str, Any]:
    """What the page shows of a distribution: sets of draws. What compares single layers says nothing there."""
    evaluation = evaluated.evaluation
    strips = [strip(evaluated, index) for index in sorted(views, key=lambda index: -amount_of(evaluated, index))]
    score = evaluation.generated.resemblance
    return {
        "headline": "draws not compared" if score is None else f"resemblance {score:.3f}",
        "verdict": draw_verdict(evaluation),
        "parts": part_bars(evaluation),
        "strips": strips[:1],
        "strip_columns": STRIP,
        "vehicles": strips[1:],
        "relit": [shown(scene) for scene in evaluated.relit],
        "textures": [drawn_textures(evaluated, index) for index in views[:_TEXTURES]],
    }


def _render(contents: dict[str, Any]) -> str:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("svbrdfgan.report", ""),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["data_uri"] = data_uri
    return environment.get_template("report.html.j2").render(contents)


def _yaml(config: StrictModel) -> str:
    """The configuration as users write it."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=100)
