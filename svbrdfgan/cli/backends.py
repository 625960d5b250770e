"""`svbrdfgan backends` and `svbrdfgan embeddings`: what is installed, whether it works, what it can do."""

from __future__ import annotations

import json
from typing import Any

import click
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from svbrdfgan.plugins import EMBEDDINGS, RENDERERS, Plugin, list_plugins
from svbrdfgan.probe import Probe, probe_all

_STYLES = {"ok": "green", "missing": "yellow", "broken": "red"}


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print a list of objects instead of a table.")
def backends(as_json: bool) -> None:
    """List the installed renderers. Each is tried in a process of its own, so a broken one disturbs nothing."""
    _show(RENDERERS, as_json)


@click.command()
@click.option("--json", "as_json", is_flag=True, help="Print a list of objects instead of a table.")
def embeddings(as_json: bool) -> None:
    """List the installed UV embeddings. Each is tried in a process of its own, so a broken one disturbs nothing."""
    _show(EMBEDDINGS, as_json)


def _show(group: str, as_json: bool) -> None:
    plugins = list_plugins(group)
    rows = list(zip(plugins, probe_all(plugins), strict=True))
    if as_json:
        click.echo(json.dumps([_record(*row) for row in rows], indent=2))
        return
    table = Table("name", "distribution", "status", "device" if group == RENDERERS else "", "capabilities")
    for plugin, probe in rows:
        status = f"[{_STYLES[probe.status]}]{probe.status}[/]"
        table.add_row(plugin.name, plugin.origin, status, probe.device or "", escape(_details(probe)))
    Console().print(table)


def _record(plugin: Plugin, probe: Probe) -> dict[str, Any]:
    return {
        "name": plugin.name,
        "distribution": plugin.distribution,
        "version": plugin.version,
        "status": probe.status,
        "reason": probe.reason,
        "device": probe.device,
        "capabilities": probe.capabilities,
    }


def _details(probe: Probe) -> str:
    """The capabilities in words, or the reason why there are none."""
    return probe.reason or "; ".join(_in_words(name, value) for name, value in (probe.capabilities or {}).items())


def _in_words(name: str, value: object) -> str:
    name = name.replace("_", " ")
    if isinstance(value, bool):
        return name if value else f"not {name}"
    return f"{name}: {', '.join(value) if isinstance(value, list) else value}"
