"""`svbrdfgan experiment`: the thesis's experiments (chapter 5) and ours, each with a table and pictures."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import click

from svbrdfgan.cli.display import echo, print_table, progress


@click.command("experiment")
@click.argument("words", nargs=-1, metavar="NAME... [KEY=VALUE]...")
@click.option("--list", "listing", is_flag=True, help="List the experiments, and stop.")
@click.option(
    "--profile", default="cpu", show_default=True, type=click.Choice(["cpu", "gpu"]), help="Size of data and training."
)
@click.option("-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder of all experiments.")
@click.option(
    "--assets",
    envvar="SVBRDFGAN_ASSETS",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    help="Folder with cars/ and envmaps/, which the gpu profile needs.  [default: $SVBRDFGAN_ASSETS]",
)
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(1), help="Runs at once, over all GPUs.")
@click.option("--seeds", metavar="0,1,2", help="Seeds of every row.  [default: those that the rows name]")
@click.option("--only", multiple=True, metavar="NAME/ROW/RECIPE/SEED", help="Only these runs, in this order.")
@click.option(
    "--until", type=click.FloatRange(0), metavar="MINUTES", help="Stop then; unfinished runs continue next time."
)
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
    """Run experiments, by name or from YAML files of your own, and write OUT/NAME/table.md of each, with pictures.

    The command can be stopped at any time, also by --until. Run again, it continues, and tries what failed again. The
    exit code is 1 if a run failed. `--until 0` only writes the tables.

    Experiments in one OUT share equal data sets, oracles and runs. A second command on one OUT is refused; give
    several names to one command instead.

    --only takes names as in OUT/NAME/table.md, or shell patterns. Parts left out at the end match everything:
    `--only 'pose-noise/noise-10'`, `--only '*/*/default/0'`. KEY=VALUE changes the configuration of all rows, such as
    `train.minutes=1` or `dataset.spp=16`. The gpu profile is the real experiment; cpu shows the trend, in about two
    minutes for each run.
    """
    if listing:
        _list(profile)
        return
    names = tuple(word for word in words if "=" not in word)
    if not names or out is None:
        raise click.UsageError("NAME and --out are wanted; `svbrdfgan experiment --list` shows the names.")
    numbers = _numbers(seeds)
    kept = f"{out} keeps what is complete and the checkpoints of runs, and the same command continues."
    with progress("reading the experiments", lambda: kept) as display:
        from svbrdfgan.experiments.run_matrix import RunMatrix
        from svbrdfgan.experiments.runner import run_experiments

        matrices = [RunMatrix.load(name, profile, [word for word in words if "=" in word]) for name in names]
        results = run_experiments(
            matrices,
            out,
            assets=assets,
            jobs=jobs,
            only=only,
            seeds=numbers,
            minutes=math.inf if until is None else until,
            display=display,
        )
    for each in results:
        for line, run in each.failures:
            echo(f"failed: {line.row}, {line.recipe}, seed {run.seed}: {run.reason}", err=True)
        echo(str(out / each.matrix.name / "table.md"))
    if any(each.failures for each in results):
        raise click.exceptions.Exit(1)


def _list(profile: Literal["cpu", "gpu"]) -> None:
    from rich.table import Table

    table = Table("name", "thesis", "rows", "runs", "minutes", "what")
    with progress("reading the experiments"):
        from svbrdfgan.experiments.definition import experiment_names
        from svbrdfgan.experiments.plan import Plan

        for name in experiment_names():
            plan = Plan.load(name, profile)
            runs, experiment = plan.runs(), plan.experiment
            minutes = sum(plan.settings(row)["train"].get("minutes") or 0.0 for row, _, _ in runs)
            row = (len(experiment.rows), len(runs), round(minutes))
            table.add_row(name, experiment.figure, *map(str, row), experiment.title)
    print_table(table)
    echo(f"Minutes of training in profile {profile}, one run at a time. Shared runs count in each experiment.")


def _numbers(text: str | None) -> tuple[int, ...]:
    try:
        return tuple(map(int, text.split(","))) if text else ()
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is no list such as 0,1,2.", param_hint="--seeds") from error
