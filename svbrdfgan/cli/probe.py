"""`svbrdfgan probe`: what besides texture a discriminator could tell real from fake by, found before training."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import echo, print_table, progress
from svbrdfgan.cli.options import memory_option, read_config
from svbrdfgan.utils.devices import DEVICES

if TYPE_CHECKING:
    from rich.table import Table

    from svbrdfgan.evaluation.leakage.report import LeakageReport


@click.command("probe")
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option(
    "-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for probe.json and pairs.png."
)
@click.option(
    "--true-layers",
    is_flag=True,
    help="Both sides show the exemplars' true layers, as of a perfect generator; not none.",
)
@click.option(
    "--minutes",
    type=click.FloatRange(min=0, min_open=True),
    help="Limit on the learning of all probes together; rendering comes before and is not counted.",
)
@click.option("--device", type=click.Choice(DEVICES), help="Instead of CONFIG's.")
@memory_option
def command(
    config: Path,
    overrides: tuple[str, ...],
    out: Path | None,
    true_layers: bool,
    minutes: float | None,
    device: str | None,
) -> None:
    """Find what besides texture would tell real from fake in a training run with the YAML file CONFIG.

    A discriminator learns to tell unweathered renders of the exemplars' scenes from unweathered renders of the fakes'
    scenes, and is judged on vehicles that it did not learn from. 50 % is chance: nothing but texture tells them apart.
    KEY=VALUE replaces a value of CONFIG.
    """
    with progress("opening the data set") as display:
        from svbrdfgan.evaluation.leakage.probe import probe_shortcuts
        from svbrdfgan.training.config import train_config

        words = (*overrides, f"device={device}") if device else overrides
        training = train_config(read_config(config, words), str(config))
        probed = probe_shortcuts(
            training, base=config.parent, true_layers=true_layers, minutes=minutes, display=display
        )
        if out:
            display.stage(f"writing {out}")
            probed.save(out)
    print_table(_table(probed.report))
    for line in probed.report.lines():
        echo(line)
    if out:
        echo(f"written to {out}")


def _table(report: LeakageReport) -> Table:
    from rich.table import Table

    shown = {"none": "unweathered pictures", "true": "pictures of true layers"}[report.layers]
    title = f"share of {report.judged} pairs of {shown} in which the real one was recognised"
    table = Table("confounder", "real and fake", "verdict", "99 % interval", title=title)
    for name, finding in (*report.alone.items(), ("all together", report.together)):
        share = finding.share
        interval = "" if share is None else f"{share.low:.0%} to {share.high:.0%}"
        table.add_row(name, finding.differs or "-", finding.verdict, interval)
    return table
