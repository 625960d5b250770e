"""`svbrdfgan train`: the GAN of thesis 4.3."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("train")
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder of the run.")
@click.option(
    "--resume", is_flag=True, help="Go on from the latest checkpoint; on a CPU to the same weights as if never stopped."
)
def command(config: Path, overrides: tuple[str, ...], out: Path, resume: bool) -> None:
    """Train a generator as CONFIG says.

    KEY=VALUE replaces a value of CONFIG, such as `steps=500` or `loss.r1=0.1`.
    """
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
    from svbrdfgan.training.config import train_config
    from svbrdfgan.training.trainer import train

    declared = train_config(apply_overrides(load_yaml(config), overrides), str(config))
    try:
        with terminal_display(Console(stderr=True)) as display:
            state = train(declared, out, base=config.parent, resume=resume, display=display)
    except KeyboardInterrupt:
        click.echo(f"{out}: stopped; the same command with --resume goes on.", err=True)
        raise
    best = f", validation recovered {state.best[0]:.3f} at step {state.best[1]}" if state.history else ""
    click.echo(f"{out}: {state.step} steps in {state.seconds / 60:.1f} minutes{best}")
