"""`svbrdfgan evaluate`: the verdict on a run, and its report."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import click


@click.command("evaluate")
@click.argument("run", type=click.Path(path_type=Path))
@click.option("--split", default="test", show_default=True, type=click.Choice(["train", "validation", "test"]))
@click.option("--no-oracle", is_flag=True, help="Leave out the supervised oracle, which takes minutes the first time.")
@click.option("--dataset", type=click.Path(path_type=Path), help="Where the run's data set is now, if it was moved.")
@click.option("--device", default="auto", show_default=True, type=click.Choice(["auto", "cpu", "cuda"]))
def command(
    run: Path,
    split: Literal["train", "validation", "test"],
    no_oracle: bool,
    dataset: Path | None,
    device: Literal["auto", "cpu", "cuda"],
) -> None:
    """Score RUN on a split it was not trained on; write evaluation.json and report.html into it.

    Those of another split than test are named after it: report.validation.html.
    """
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.evaluation.evaluate import evaluate
    from svbrdfgan.report.page import write_report

    with terminal_display(Console(stderr=True)) as display:
        evaluated = evaluate(run, split=split, oracle=not no_oracle, device=device, dataset=dataset, display=display)
    for line in evaluated.evaluation.lines():
        click.echo(line)
    click.echo(str(write_report(run, evaluated)))
