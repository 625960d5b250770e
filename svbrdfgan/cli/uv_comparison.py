"""`svbrdfgan embeddings --compare DIR`: embeddings side by side, measured over a folder of meshes."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from svbrdfgan.cli.display import echo, print_json, print_table, progress
from svbrdfgan.cli.options import key_values
from svbrdfgan.errors import PluginError
from svbrdfgan.metrics.uv.compare import Measured, as_json, measure_embedding, mesh_files
from svbrdfgan.metrics.uv.xatlas_baseline import NAME, XatlasBaseline, xatlas_installed
from svbrdfgan.plugins.registry import EMBEDDINGS, list_plugins, load_embedding
from svbrdfgan.protocols import UVEmbedding

log = logging.getLogger(__name__)

_HEADINGS = {
    "stretch_l2": "L2 stretch",
    "stretch_linf": "L-infinity stretch",
    "stretch_p99": "stretch, 99th percentile",
    "angle_mean": "angle distortion, mean",
    "angle_p99": "angle distortion, 99th percentile",
    "area_mean": "area distortion, mean",
    "area_p99": "area distortion, 99th percentile",
    "collapsed": "collapsed area",
    "flipped": "flipped area",
    "overlapping": "overlapping area",
    "coverage": "coverage of the square",
    "seam_length": "seam length / sqrt(area)",
    "charts": "charts",
    "connectivity": "connectivity",
    "kept": "outside that is not hidden",
    "similarity": "similarity: distance in UV",
    "matched": "similarity: places matched",
    "seconds": "seconds to embed",
}


def compare(folder: Path, names: Sequence[str], resolution: int, wants_json: bool) -> None:
    """Prints the medians and the worst of every measure, a column for each embedding; or all of it as JSON."""
    meshes = mesh_files(folder)
    results = {name: _measured(name, embedding, meshes, resolution) for name, embedding in _embeddings(names).items()}
    if wants_json:
        print_json(as_json(results))
    else:
        _show(results, len(meshes))


def _measured(name: str, embedding: UVEmbedding, meshes: Mapping[str, Path], resolution: int) -> Measured:
    """The measures of an embedding; meanwhile the terminal shows at which mesh it is."""
    with progress(name) as display:
        return measure_embedding(embedding, meshes, resolution, lambda at: display.stage(f"{name}: {at}"))


def _embeddings(names: Sequence[str]) -> dict[str, UVEmbedding]:
    """The embeddings that are named; else all that work, and xatlas where it is installed."""
    if names:
        return {name: XatlasBaseline() if name == NAME else _configured(name) for name in names}
    found: dict[str, UVEmbedding] = {}
    for plugin in list_plugins(EMBEDDINGS):
        try:
            found[plugin.name] = load_embedding(plugin.name)
        except PluginError as error:
            log.warning("left out: %s", error)
    return {**found, NAME: XatlasBaseline()} if xatlas_installed() else found


def _configured(words: str) -> UVEmbedding:
    """The embedding of a name and its options, as in "stretch,seams=2"."""
    name, *options = words.split(",")
    return load_embedding(name, key_values(tuple(options)))


def _show(results: Mapping[str, Measured], meshes: int) -> None:
    table = Table("median / worst", *map(escape, results))
    summaries = {name: measured.summary() for name, measured in results.items()}
    for key, heading in _HEADINGS.items():
        cells = [_cell(summary.get(key)) for summary in summaries.values()]
        table.add_row(heading, *cells)
    table.add_row("meshes that failed", *(f"{len(measured.failures)} of {meshes}" for measured in results.values()))
    print_table(table)
    pairs = max((len(measured.similarities) for measured in results.values()), default=0)
    echo("Stretch and distortion: 1 is none. Shares are of the area that is seen from outside.")
    echo(f"Similarity: pairs of meshes measured: {pairs}, the same ones at every call.")
    for name, measured in results.items():
        for mesh, reason in measured.failures.items():
            echo(f"{name}: {mesh}: {reason}")


def _cell(row: Mapping[str, float] | None) -> str:
    return "" if row is None else f"{row['median']:.4g} / {row['worst']:.4g}"
