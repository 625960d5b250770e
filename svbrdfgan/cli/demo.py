"""`svbrdfgan demo`: the whole loop on procedural vehicles."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("demo")
@click.option("--out", default="out/demo", show_default=True, type=click.Path(path_type=Path, file_okay=False))
def command(out: Path) -> None:
    """Make a data set, train on it, weather a vehicle that was never seen, and write it with a report.

    Ten minutes on two CPU cores. Run again, it goes on where it was stopped; choose another folder to start afresh.
    """
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.experiments.demo.run import run_demo

    with terminal_display(Console(stderr=True)) as display:
        result = run_demo(out, display)
    for line in result.evaluation.lines():
        click.echo(line)
    click.echo(f"a vehicle it never saw:  {result.vehicle}")
    click.echo(f"report with pictures:    {result.report}")
