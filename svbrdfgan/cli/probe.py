"""`svbrdfgan probe`: what a discriminator could cheat with, before a training run is spent on it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from rich.table import Table

    from svbrdfgan.evaluation.leakage.report import LeakageReport

_WIDE = 140


@click.command("probe")
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option(
    "-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder for probe.json and pairs.png."
)
@click.option(
    "--minutes",
    type=click.FloatRange(min=0, min_open=True),
    help="Most time for learning, over all probes; pictures are made first.",
)
@click.option("--device", type=click.Choice(["auto", "cpu", "cuda"]), help="Instead of CONFIG's.")
def command(
    config: Path, overrides: tuple[str, ...], out: Path | None, minutes: float | None, device: str | None
) -> None:
    """Find what would tell real from fake besides the texture, if one trained as CONFIG says.

    A discriminator learns to tell clean, unweathered renders in the exemplars' scenes from clean ones in the fakes'
    scenes, and is judged on vehicles that it did not learn from. 50 % is chance: nothing to cheat with.
    """
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
    from svbrdfgan.evaluation.leakage import probe_shortcuts
    from svbrdfgan.training.config import train_config

    words = (*overrides, f"device={device}") if device else overrides
    declared = train_config(apply_overrides(load_yaml(config), words), str(config))
    with terminal_display(Console(stderr=True)) as display:
        probed = probe_shortcuts(declared, base=config.parent, minutes=minutes, display=display)
    terminal = Console()
    console = terminal if terminal.is_terminal else Console(width=_WIDE)
    console.print(_table(probed.report))
    for line in probed.report.lines():
        click.echo(line)
    if out:
        probed.save(out)
        click.echo(f"written to {out}")


def _table(diagnosis: LeakageReport) -> Table:
    from rich.table import Table

    judged = f"the exemplar's picture was picked in so many of {diagnosis.judged} pairs of clean pictures"
    table = Table("nuisance", "real and fake", "verdict", "99 % interval", title=judged)
    for name, finding in (*diagnosis.alone.items(), ("all together", diagnosis.together)):
        share = finding.share
        interval = "" if share is None else f"{share.low:.0%} to {share.high:.0%}"
        table.add_row(name, finding.differs or "-", finding.verdict, interval)
    return table
