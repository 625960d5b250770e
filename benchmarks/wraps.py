"""Measures of the surface that `lscm` and `stretch` unwrap, over a folder of meshes: their guarantees hold there.

    python benchmarks/wraps.py DIR

`svbrdfgan embeddings --compare DIR` measures the same on the meshes' own faces, after the UV transfer.
"""

from __future__ import annotations

import json
import statistics
import time
from pathlib import Path

import click
import numpy as np
from rich.table import Table
from svbrdfgan_igl import LscmEmbedding, StretchEmbedding

from svbrdfgan.cli.display import print_table, progress
from svbrdfgan.errors import SvbrdfganError
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.metrics.uv.compare import mesh_files, sample_pairs
from svbrdfgan.metrics.uv.neighbours import similarity
from svbrdfgan.metrics.uv.summary import UVSummary
from svbrdfgan.metrics.uv.visibility import VisibleSurface
from svbrdfgan.utils.display import Display

EMBEDDINGS = {"stretch": StretchEmbedding, "lscm": LscmEmbedding}
SHOWN = ("stretch_l2", "stretch_linf", "angle_mean", "area_mean", "flipped", "overlapping", "coverage")

Rows = dict[str, dict[str, float]]


@click.command()
@click.argument("folder", type=click.Path(path_type=Path))
@click.option("--json", "file", type=click.Path(dir_okay=False, path_type=Path), help="Also write the figures here.")
def main(folder: Path, file: Path | None) -> None:
    """Prints medians and the worst, and on which meshes `stretch` is worse than `lscm`."""
    meshes = mesh_files(folder)
    rows: dict[str, Rows] = {}
    alike: dict[str, list[float]] = {}
    with progress("opening the meshes") as display:
        for name in EMBEDDINGS:
            display.begin(name, len(meshes))
            rows[name], alike[name] = _measured(name, meshes, display)
    table = Table("median / least / greatest", *rows)
    for key in (*SHOWN, "seconds"):
        table.add_row(key, *(_cell([row[key] for row in found.values()]) for found in rows.values()))
    table.add_row("similarity", *map(_cell, alike.values()))
    table.add_row("failed", *(f"{len(meshes) - len(found)} of {len(meshes)}" for found in rows.values()))
    print_table(table)
    ours, theirs = (rows[name] for name in EMBEDDINGS)
    worse = [name for name in ours if name in theirs and ours[name]["stretch_l2"] > theirs[name]["stretch_l2"]]
    click.echo(f"stretch has more L2 stretch than lscm on: {', '.join(worse) or 'none'}")
    if file:
        file.write_text(json.dumps({"meshes": rows, "similarity": alike}, indent=1) + "\n", encoding="utf-8")


def _measured(name: str, meshes: dict[str, Path], display: Display) -> tuple[Rows, list[float]]:
    rows: Rows = {}
    found: dict[str, VisibleSurface] = {}
    for file, path in meshes.items():
        display.advance(1, file)
        mesh = load_mesh(path)
        start = time.perf_counter()
        try:
            chart = EMBEDDINGS[name]().chart(mesh)
        except SvbrdfganError as error:
            click.echo(f"{name}: {file}: {error}")
            continue
        seconds = time.perf_counter() - start
        points = chart.frame.low + chart.disk.positions * chart.frame.size
        uv, bounds = chart.uv[chart.disk.faces], np.stack([points.min(axis=0), points.max(axis=0)])
        found[file] = VisibleSurface(points, chart.disk.faces, uv, bounds, (False, False), np.arange(len(uv)))
        rows[file] = {**UVSummary.of(found[file]).flat(), "seconds": seconds}
    return rows, [similarity(found[one], found[other]).mean for one, other in sample_pairs(list(found))]


def _cell(values: list[float]) -> str:
    return f"{statistics.median(values):.4g} / {min(values):.4g} / {max(values):.4g}" if values else ""


if __name__ == "__main__":
    main()
