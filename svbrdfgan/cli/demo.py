"""`svbrdfgan demo`: the whole loop on procedural vehicles."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import echo, progress


@click.command("demo")
@click.option(
    "--out",
    default="out/demo",
    show_default=True,
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder to write.",
)
def command(out: Path) -> None:
    """Show rust and road dirt on a vehicle; then make a data set, train on it, and weather a vehicle of its test split.

    On two CPU cores the picture is there within two minutes, the report within ten. Run again, it continues where it
    was stopped; another --out starts from nothing.
    """
    kept = f"{out} keeps what is complete, and the same command continues."
    with progress("starting the demo", lambda: kept) as display:
        from svbrdfgan.experiments.demo import open_demo, run_demo

        opening = open_demo(out, display)
    echo(f"rust and road dirt:      {opening}")
    with progress("making the data set", lambda: kept) as display:
        result = run_demo(out, display)
    for line in result.evaluation.lines():
        echo(line)
    echo(f"a vehicle it never saw:  {result.vehicle}")
    echo(f"report with pictures:    {result.report}")
