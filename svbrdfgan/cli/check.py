"""`svbrdfgan check`: the conformance kit on an installed plugin, and installed renderers against each other."""

from __future__ import annotations

import dataclasses
import itertools
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import click
from rich import box
from rich.table import Table
from rich.text import Text

from svbrdfgan.cli.display import echo, output_console, print_json, print_table, progress
from svbrdfgan.cli.options import json_option, key_values
from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan.plugins.registry import EMBEDDINGS, RENDERERS, Plugin, find_plugin, list_plugins

if TYPE_CHECKING:
    from svbrdfgan.testing import Outcome
    from svbrdfgan.testing.kit import Kit, Status
    from svbrdfgan.testing.pairs.table import Row

_STYLES: Mapping[Status, str] = {
    "passed": "green",
    "failed": "bold red",
    "known failure": "yellow",
    "not declared": "dim",
}
_GROUPS = {"renderer": RENDERERS, "embedding": EMBEDDINGS}


@click.command("check")
@click.argument("name", required=False)
@click.option(
    "--renderer", "kind", flag_value="renderer", help="NAME is a renderer; needed if an embedding has that name too."
)
@click.option(
    "--embedding",
    "kind",
    flag_value="embedding",
    help="NAME is a UV embedding; needed if a renderer has that name too.",
)
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the plugin; repeatable.")
@click.option("--only", default="", metavar="TEXT", help="Run only the tests whose group.name contains TEXT.")
@click.option(
    "--power",
    type=click.FloatRange(0.0, 1.0, min_open=True),
    default=1.0,
    show_default=True,
    help="Share of the samples that statistical tests take: with a quarter, they find errors twice as large.",
)
@json_option("a list of objects")
@click.option("--pairs", is_flag=True, help="Compare the installed renderers with each other, or NAME with all others.")
@click.option(
    "--profile", type=click.Choice(["ci", "slow"]), help="With --pairs: how many samples are taken.  [default: ci]"
)
@click.option("--scene", "scenes", multiple=True, metavar="SCENE", help="With --pairs: only this scene; repeatable.")
@click.option("--markdown", is_flag=True, help="With --pairs: print the table as Markdown.")
def command(
    name: str | None,
    kind: str | None,
    options: tuple[str, ...],
    only: str,
    power: float,
    as_json: bool,
    pairs: bool,
    profile: str | None,
    scenes: tuple[str, ...],
    markdown: bool,
) -> None:
    """Run the conformance kit on the renderer or UV embedding NAME, and print which of its claims hold.

    The plugin is tried in its own process first, so that a plugin that aborts is reported as such. Exits with 1 if a
    test failed. --pairs prints the table of `docs/consistency.md` instead: whether renderers agree with each other.
    """
    if pairs and (options or only or power != 1.0):
        raise click.UsageError("--option, --only and --power are for one plugin: leave them out, or --pairs.")
    if not pairs and (scenes or markdown or profile is not None):
        raise click.UsageError("--profile, --scene and --markdown need --pairs.")
    if pairs:
        return _show_pairs(name, profile or "ci", scenes, "json" if as_json else "markdown" if markdown else "table")
    if name is None:
        raise click.UsageError("give the NAME of a renderer or UV embedding, or --pairs.")
    outcomes = _outcomes(_plugin(name, kind), key_values(options), power, only)
    if as_json:
        print_json([dataclasses.asdict(outcome) for outcome in outcomes])
    else:
        print_table(table(outcomes))
        output_console().print(summary(outcomes), highlight=False)
    if any(outcome.status == "failed" for outcome in outcomes):
        raise click.exceptions.Exit(1)


def table(outcomes: Sequence[Outcome]) -> Table:
    """A row for each test: its claim, its status and seconds; beneath the claim, why it did not pass."""
    result = Table(box=box.SIMPLE_HEAD, show_edge=False, pad_edge=False)
    result.add_column("what holds")
    result.add_column("status", no_wrap=True)
    result.add_column("s", justify="right", no_wrap=True)
    for group, tests in itertools.groupby(outcomes, key=lambda outcome: outcome.group):
        result.add_row(f"[bold]{group}[/]")
        for outcome in tests:
            status = f"[{_STYLES[outcome.status]}]{outcome.status}[/]"
            result.add_row(_claim(outcome), status, f"{outcome.seconds:.1f}")
        result.add_section()
    return result


def summary(outcomes: Sequence[Outcome]) -> str:
    """The number of tests of each status, in one line."""
    counts = Counter(outcome.status for outcome in outcomes)
    parts = [f"[{style}]{counts[status]} {status}[/]" for status, style in _STYLES.items() if counts[status]]
    return f"{', '.join(parts)} in {sum(outcome.seconds for outcome in outcomes):.1f} s"


def _claim(outcome: Outcome) -> Table:
    """The claim after a dash; beneath it, aligned, why it failed and how to run it again."""
    style = {"failed": "bold", "not declared": "dim"}.get(outcome.status, "")
    lines = Table.grid(padding=(0, 1))
    lines.add_row(Text("-", "dim"), Text(outcome.claim, style))
    if outcome.status == "failed":
        lines.add_row("", Text(outcome.message, "red"))
        lines.add_row("", Text(f"again: --only {outcome.group}.{outcome.name}", "dim"))
    elif outcome.status == "known failure":
        lines.add_row("", Text(outcome.message, "yellow"))
    return lines


def _plugin(name: str, kind: str | None) -> Plugin:
    """The plugin of that name; `kind` is needed only if both kinds have one."""
    names = {noun: sorted(plugin.name for plugin in list_plugins(group)) for noun, group in _GROUPS.items()}
    having = [kind] if kind else [noun for noun in _GROUPS if name in names[noun]]
    if len(having) > 1:
        raise ConfigError(f"{name!r} is a renderer and an embedding; say --renderer or --embedding.")
    if not having:
        known = "; ".join(f"{noun}s: {', '.join(found) or 'none'}" for noun, found in names.items())
        raise PluginError(f"no renderer and no embedding is called {name!r}; installed are {known}.")
    return find_plugin(_GROUPS[having[0]], name)


def _kit(plugin: Plugin, options: dict[str, Any], power: float) -> type[Kit]:
    """The tests of the plugin, after it was made with the options in a process of its own and in this one."""
    from svbrdfgan.plugins.probe import probe
    from svbrdfgan.plugins.registry import make

    outcome = probe(plugin)
    if outcome.status != "ok":
        raise PluginError(outcome.reason or f"{plugin.title} does not work.")
    make(plugin, options)
    from svbrdfgan.testing import RendererTests, UVEmbeddingTests

    tests: type[Kit] = RendererTests if plugin.group == RENDERERS else UVEmbeddingTests
    return type("Checked", (tests,), {"name": plugin.name, "options": options, "power": power})


def _outcomes(plugin: Plugin, options: dict[str, Any], power: float, only: str) -> list[Outcome]:
    """The outcome of each test."""
    outcomes: list[Outcome] = []
    with progress(f"trying {plugin.title} in its own process") as display:
        from svbrdfgan.testing.kit import names_of_tests, run_kit

        kit = _kit(plugin, options, power)
        display.begin(plugin.title, None if only else len(names_of_tests(kit)))
        for outcome in run_kit(kit, only):
            outcomes.append(outcome)
            display.advance(1, f"after {outcome.group}.{outcome.name}")
    if not outcomes:
        raise ConfigError(f"--only {only!r} names no test; run without it to see their groups.")
    return outcomes


def _show_pairs(name: str | None, profile: str, scenes: Sequence[str], output: str) -> None:
    """Prints the table as "table", "markdown" or "json"; with a name, the pairs of that renderer alone.

    Raises:
        PluginError: there is no renderer of that name, or it does not work.
        click.exceptions.Exit: a pair disagrees, or was not compared well enough to tell.
    """
    rows: list[Row] = []
    with progress("trying the renderers, each in its own process") as display:
        from svbrdfgan.testing.pairs import show
        from svbrdfgan.testing.pairs.pair_scene import SCENES
        from svbrdfgan.testing.pairs.references import load_reference
        from svbrdfgan.testing.pairs.sampling import PROFILES
        from svbrdfgan.testing.pairs.table import Table as PairsTable
        from svbrdfgan.testing.pairs.table import installed_renderers

        makers = installed_renderers()
        if name and name not in makers:
            raise PluginError(
                f"{find_plugin(RENDERERS, name).title} does not work here; `svbrdfgan backends` says why."
            )
        table = PairsTable(PROFILES[profile], makers, load_reference(), frozenset({name} if name else ()))
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
        print_table(show.rich_table(rows, output_console().width))
        for line in show.explanations(rows):
            echo(line)
    if any(row.failed for row in rows):
        raise click.exceptions.Exit(1)
