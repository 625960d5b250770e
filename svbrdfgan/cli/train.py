"""`svbrdfgan train`: trains the GAN of thesis 4.3."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import memory_option, read_config


@click.command("train")
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder of the run.")
@click.option(
    "--resume",
    is_flag=True,
    help="Continue from the latest checkpoint; on a CPU, to the same weights as without the interruption.",
)
@memory_option
def command(config: Path, overrides: tuple[str, ...], out: Path, resume: bool) -> None:
    """Train a generator as the YAML file CONFIG says.

    KEY=VALUE replaces a value of CONFIG, such as `steps=500` or `loss.r1=0.1`.
    """
    with progress("opening the data set", lambda: _kept(out)) as display:
        from svbrdfgan.training.config import train_config
        from svbrdfgan.training.trainer import train

        training = train_config(read_config(config, overrides), str(config))
        state = train(training, out, base=config.parent, resume=resume, display=display)
    scores = state.history[-1].keys() - {"step", "seconds"} if state.history else ()
    best = "".join(f", validation {name} {state.best[0]:.3f} at step {state.best[1]}" for name in scores)
    echo(f"{out}: {state.step} steps in {state.seconds / 60:.1f} minutes{best}")


def _kept(run: Path) -> str:
    found = sorted((run / "checkpoints").glob("step_*"))  # `checkpoints` of the training would import torch
    if not found:
        return f"{run} has no checkpoint yet, and the same command starts anew."
    step = int(found[-1].name.removeprefix("step_"))
    return f"{run} keeps the checkpoint of step {step}, and the same command with --resume continues."
