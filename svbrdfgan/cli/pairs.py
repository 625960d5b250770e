"""`svbrdfgan check --pairs`: whether the installed renderers agree with each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click
from rich.console import Console

from svbrdfgan.cli.display import terminal_display
from svbrdfgan.errors import PluginError
from svbrdfgan.plugins import RENDERERS, find_plugin

if TYPE_CHECKING:
    from svbrdfgan.testing.pairs.table import Row


def show_pairs(name: str | None, profile: str, scenes: Sequence[str], output: str) -> None:
    """Prints the table as "table", "markdown" or "json"; with a name, the pairs of that renderer alone.

    Raises:
        PluginError: there is no renderer of that name, or it does not work.
        click.exceptions.Exit: a pair disagrees, or was not compared well enough to tell.
    """
    from svbrdfgan.testing.pairs import show
    from svbrdfgan.testing.pairs.references import load_reference
    from svbrdfgan.testing.pairs.sampling import PROFILES
    from svbrdfgan.testing.pairs.scenes import SCENES
    from svbrdfgan.testing.pairs.table import Table, installed_renderers

    makers = installed_renderers()
    if name and name not in makers:
        raise PluginError(f"{find_plugin(RENDERERS, name).title} does not work here; `svbrdfgan backends` says why.")
    table = Table(PROFILES[profile], makers, load_reference(), frozenset({name} if name else ()))
    rows: list[Row] = []
    with terminal_display(Console(stderr=True)) as display:
        display.begin(f"pairs of renderers, {profile} profile", len(scenes or SCENES))
        for scene in scenes or SCENES:
            display.advance(0, scene)
            rows += table.rows(scene)
            display.advance()
    if output == "json":
        click.echo(show.as_json(rows))
    elif output == "markdown":
        click.echo(show.markdown(rows), nl=False)
    else:
        terminal = Console()
        console = terminal if terminal.is_terminal else Console(width=show.WIDE)
        console.print(show.rich_table(rows, console.width))
        for line in show.explanations(rows):
            console.print(line, highlight=False, markup=False)
    if any(row.failed for row in rows):
        raise click.exceptions.Exit(1)
