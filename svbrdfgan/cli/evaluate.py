"""`svbrdfgan evaluate`: the scores of a run, and its report."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click

from svbrdfgan.cli.display import echo, print_json, progress
from svbrdfgan.cli.options import device_option, json_option, memory_option
from svbrdfgan.utils.devices import Device
from svbrdfgan.utils.processes import cores

_BAKED, _TEXELS = ((0, 1, 2), (0.5, 1.0)), 1024
"""Seeds and amounts of the vehicle to turn about, and texels along a side of its layers."""


@click.command("evaluate")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--split",
    default="test",
    show_default=True,
    type=click.Choice(["train", "validation", "test"]),
    help="The data to score it on.",
)
@click.option("--no-oracle", is_flag=True, help="Leave out the oracle, whose training takes minutes.")
@click.option(
    "--relight",
    "relight",
    multiple=True,
    metavar="FILES",
    help="Environment maps for relit FLIP (a shell pattern, in quotes), which training never used; may be repeated. "
    "By default procedural skies and rooms.",
)
@click.option("--dataset", type=click.Path(path_type=Path), help="The run's data set, if it was moved.")
@click.option(
    "--on",
    "on",
    type=click.Path(path_type=Path),
    metavar="DATASET",
    help="Score it on another data set, whose true layers are known, without oracle; replaces the run's own scores.",
)
@device_option
@click.option(
    "--view",
    is_flag=True,
    help="Put the first vehicle of the split, to turn about, into the report; takes a minute.",
)
@json_option("the contents of evaluation.json")
@click.option(
    "--workers",
    type=click.IntRange(1),
    help="Processes that paint true layers, for draws.  [default: one for each core]",
)
@memory_option
def command(
    run: Path,
    split: Literal["train", "validation", "test"],
    no_oracle: bool,
    relight: tuple[str, ...],
    dataset: Path | None,
    on: Path | None,
    device: Device,
    view: bool,
    as_json: bool,
    workers: int | None,
) -> None:
    """Score the generator of the folder RUN on a split, and write evaluation.json and report.html into RUN.

    For splits other than test, the files are named after the split: report.validation.html.
    """
    if dataset and on:
        raise click.UsageError("--dataset is where the run's own data set was moved, and --on is another: choose one.")
    kept = f"{run} keeps earlier scores and an oracle that was trained; the same command scores again."
    with progress(f"opening {run}", lambda: kept) as display:
        from svbrdfgan.evaluation.evaluate import evaluate
        from svbrdfgan.evaluation.relight import Relight
        from svbrdfgan.io.claims import claimed
        from svbrdfgan.models.shipped import CONFIG
        from svbrdfgan.report.page import write_report

        with claimed(run / CONFIG, f"{run} is being evaluated by another process"):
            live = None
            if view:
                from svbrdfgan.viewer.open import exhibit_of
                from svbrdfgan.viewer.page import baked_page

                shown = exhibit_of(run, dataset=on or dataset, split=split, fine=_TEXELS, baked=_BAKED)
                live = baked_page(shown, display)
            evaluated = evaluate(
                run,
                split=split,
                oracle=not no_oracle,
                device=device,
                dataset=dataset,
                on=on,
                relight=Relight(relight),
                workers=workers or cores(),
                display=display,
            )
            display.stage("writing the report")
            report = write_report(run, evaluated, live)
    if as_json:
        print_json(evaluated.evaluation.model_dump(mode="json"))
        return
    for line in evaluated.evaluation.lines():
        echo(line)
    echo(str(report))
