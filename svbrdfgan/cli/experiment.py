"""`svbrdfgan experiment`: the thesis's experiments (chapter 5) and ours, each to a table and pictures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import click


@click.command("experiment")
@click.argument("words", nargs=-1, metavar="NAME... [KEY=VALUE]...")
@click.option("--list", "listing", is_flag=True, help="Say what there is, and stop.")
@click.option("--profile", default="cpu", show_default=True, type=click.Choice(["cpu", "gpu"]), help="How large a one.")
@click.option("-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder of all experiments.")
@click.option(
    "--assets",
    envvar="SVBRDFGAN_ASSETS",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder with cars/ and envmaps/, which the gpu profile needs.",
)
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(1), help="Runs at once, over all GPUs.")
@click.option("--seeds", metavar="0,1,2", help="Instead of those that each row names.")
@click.option("--only", multiple=True, metavar="NAME/ROW/RECIPE/SEED", help="These runs alone, in this order.")
@click.option("--until", type=click.FloatRange(0), metavar="MINUTES", help="Stop then; what runs goes on next time.")
def command(
    words: tuple[str, ...],
    listing: bool,
    profile: Literal["cpu", "gpu"],
    out: Path | None,
    assets: Path | None,
    jobs: int,
    seeds: str | None,
    only: tuple[str, ...],
    until: float | None,
) -> None:
    """Run experiments, or those of YAML files of your own, and write OUT/NAME/table.md of each, with its pictures.

    Stop it when you like, or have it stopped by --until; run again, it goes on, and what failed is tried again. Exits
    with 1 where a run failed. With `--until 0` it only writes the tables. Experiments in one OUT share data sets,
    oracles and runs where they are equal; give one command several names rather than two commands the same OUT.
    --only names runs as OUT/NAME/table.md does, or several by shell patterns; what is left out at the end may be
    anything: `--only 'pose-noise/noise-10'`, `--only '*/*/default/0'`. KEY=VALUE changes what all rows start from,
    such as `train.minutes=1` or `dataset.spp=16`. The gpu profile is the real one; cpu checks the trend, in some two
    minutes a run.
    """
    if listing:
        _list(profile)
        return
    names = tuple(word for word in words if "=" not in word)
    if not names or out is None:
        raise click.UsageError("NAME and --out are wanted; `svbrdfgan experiment --list` shows the names.")
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.experiments.run_matrix import Design
    from svbrdfgan.experiments.runner import run_experiments

    designs = [Design.load(name, profile, [word for word in words if "=" in word]) for name in names]
    with terminal_display(Console(stderr=True)) as display:
        results = run_experiments(
            designs,
            out,
            assets=assets,
            jobs=jobs,
            only=only,
            seeds=_numbers(seeds),
            minutes=math.inf if until is None else until,
            display=display,
        )
    for each in results:
        for line, run in each.failures:
            click.echo(f"failed: {line.row}, {line.recipe}, seed {run.seed}: {run.reason}", err=True)
        click.echo(str(out / each.design.name / "table.md"))
    if any(each.failures for each in results):
        raise click.exceptions.Exit(1)


def _list(profile: Literal["cpu", "gpu"]) -> None:
    from rich.console import Console
    from rich.table import Table

    from svbrdfgan.experiments.definition import experiment_names
    from svbrdfgan.experiments.run_matrix import Design

    table = Table("name", "thesis", "rows", "runs", "minutes", "what")
    for name in experiment_names():
        design = Design.load(name, profile)
        cells = design.cells()
        minutes = sum(cell.spec.train.minutes or 0.0 for cell in cells)
        experiment = design.experiment
        row = (len(experiment.rows), len(cells), round(minutes))
        table.add_row(name, experiment.figure, *map(str, row), experiment.title)
    Console().print(table)
    click.echo(
        f"Minutes of training in profile {profile}, one run at a time. Runs that experiments share count in each."
    )


def _numbers(text: str | None) -> tuple[int, ...]:
    try:
        return tuple(map(int, text.split(","))) if text else ()
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no list such as 0,1,2.", param_hint="--seeds") from error
