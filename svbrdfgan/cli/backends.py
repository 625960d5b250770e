"""`svbrdfgan backends` and `svbrdfgan embeddings`: what is installed, whether it works, what it can do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click
from rich.markup import escape
from rich.table import Table

from svbrdfgan.cli.display import print_json, print_table, progress
from svbrdfgan.cli.options import json_option
from svbrdfgan.plugins.probe import Probe, probe_all
from svbrdfgan.plugins.registry import EMBEDDINGS, RENDERERS, Plugin, list_plugins

_STYLES = {"ok": "green", "missing": "yellow", "broken": "red"}


@click.command()
@json_option("a list of objects")
def backends(as_json: bool) -> None:
    """List the installed renderers. Each is tried in its own process, so that a broken one stops no other."""
    _show(RENDERERS, as_json)


@click.command()
@json_option("a list of objects")
@click.option(
    "--compare",
    "folder",
    metavar="DIR",
    type=click.Path(path_type=Path, file_okay=False),
    help="Instead, measure them on the meshes in DIR: median and worst of each measure. Tens of meshes take minutes.",
)
@click.option(
    "--embedding",
    "names",
    multiple=True,
    metavar="NAME[,KEY=VALUE]...",
    help="With --compare: an embedding to measure, with its options; repeatable.  "
    "[default: all that work, and xatlas if installed]",
)
@click.option(
    "--resolution",
    default=256,
    show_default=True,
    type=click.IntRange(16, 8192),
    help="With --compare: texels along a side, at which inner layers are found and hidden.",
)
def embeddings(as_json: bool, folder: Path | None, names: tuple[str, ...], resolution: int) -> None:
    """List the installed UV embeddings, or measure them side by side with --compare.

    Each is tried in its own process, so that a broken one stops no other.
    """
    if folder is not None:
        from svbrdfgan.cli.uv_comparison import compare

        compare(folder, names, resolution, as_json)
    elif names:
        raise click.UsageError("--embedding goes with --compare DIR.")
    else:
        _show(EMBEDDINGS, as_json)


def _show(group: str, as_json: bool) -> None:
    with progress("trying each plugin in its own process"):
        plugins = list_plugins(group)
        rows = list(zip(plugins, probe_all(plugins), strict=True))
    if as_json:
        print_json([_record(*row) for row in rows])
        return
    table = Table("name", "distribution", "status", "device" if group == RENDERERS else "", "capabilities")
    for plugin, probe in rows:
        status = f"[{_STYLES[probe.status]}]{probe.status}[/]"
        table.add_row(plugin.name, plugin.origin, status, probe.device or "", escape(_details(probe)))
    print_table(table)


def _record(plugin: Plugin, probe: Probe) -> dict[str, Any]:
    return {
        "name": plugin.name,
        "distribution": plugin.distribution,
        "version": plugin.version,
        "status": probe.status,
        "reason": probe.reason,
        "device": probe.device,
        "capabilities": probe.capabilities,
        "options": probe.defaults,
    }


def _details(probe: Probe) -> str:
    """The capabilities in words, with default options, and the options; or why the plugin does not work."""
    if probe.reason is not None:
        return probe.reason
    capabilities = "; ".join(_in_words(name, value) for name, value in (probe.capabilities or {}).items())
    options = ", ".join(f"{name}={json.dumps(value).strip(chr(34))}" for name, value in probe.defaults.items())
    return f"{capabilities}\noptions: {options or 'none'}"


def _in_words(name: str, value: object) -> str:
    name = name.replace("_", " ")
    if isinstance(value, bool):
        return name if value else f"not {name}"
    return f"{name}: {', '.join(value) if isinstance(value, list) else value}"
