"""`svbrdfgan demo`: the whole loop on procedural vehicles."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import progress


@click.command("demo")
@click.option(
    "--out",
    default="out/demo",
    show_default=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to write.",
)
def command(out: Path) -> None:
    """Make a data set, train on it, weather a vehicle of the test split, and write it with a report.

    Takes ten minutes on two CPU cores. Run again, it continues where it was stopped; another --out starts from
    nothing.
    """
    with progress("starting the demo") as display:
        from svbrdfgan.experiments.demo import run_demo

        result = run_demo(out, display)
    for line in result.evaluation.lines():
        click.echo(line)
    click.echo(f"a vehicle it never saw:  {result.vehicle}")
    click.echo(f"report with pictures:    {result.report}")
