"""`svbrdfgan train`: trains the GAN of thesis 4.3."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import memory_option, read_config
from svbrdfgan.errors import SvbrdfganError, TrainingError
from svbrdfgan.utils.display import Display, SilentDisplay
from svbrdfgan.utils.printable import sentences
from svbrdfgan.utils.torchrun import Alarm, Rank, lost_process, torchrun_rank


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

    KEY=VALUE replaces a value of CONFIG, such as `steps=500` or `loss.r1=0.1`. Under torchrun all its processes train
    one generator, and share the folder of the run.
    """
    rank = torchrun_rank()
    first = rank is None or rank.number == 0
    with _one_voice(rank, out), progress("opening the data set", lambda: _kept(out)) if first else _mute() as display:
        from svbrdfgan.training.config import train_config
        from svbrdfgan.training.trainer import train

        training = train_config(read_config(config, overrides), str(config))
        state = train(training, out, base=config.parent, resume=resume, display=display)
    if not first:
        return
    scores = state.history[-1].keys() - {"step", "seconds"} if state.history else ()
    best = "".join(f", validation {name} {state.best[0]:.3f} at step {state.best[1]}" for name in scores)
    echo(f"{out}: {state.step} steps in {state.seconds / 60:.1f} minutes{best}")


def _kept(run: Path) -> str:
    found = sorted((run / "checkpoints").glob("step_*"))  # `checkpoints` of the training would import torch
    if not found:
        return f"{run} has no checkpoint yet, and the same command starts anew."
    step = int(found[-1].name.removeprefix("step_"))
    return f"{run} keeps the checkpoint of step {step}, and the same command with --resume continues."


@contextmanager
def _mute() -> Iterator[Display]:
    """For processes other than the first, which alone prints."""
    logging.disable(logging.WARNING)
    yield SilentDisplay()


@contextmanager
def _one_voice(rank: Rank | None, run: Path) -> Iterator[None]:
    """Of torchrun's processes, the first that fails says why, and the others end without a word."""
    if rank is None:
        yield
        return
    alarm = Alarm(rank)
    try:
        with alarm.heard():
            yield
    except (SvbrdfganError, RuntimeError) as error:
        if not alarm.raise_():
            raise click.exceptions.Exit(1) from None
        if isinstance(error, SvbrdfganError):
            told: SvbrdfganError = error
        elif lost_process(error):
            told = TrainingError(f"another process of the training has ended; {_kept(run)}")
        else:
            raise
        if click.get_current_context().find_root().params["debug"]:
            raise
        click.ClickException(sentences(told)).show()
        alarm.linger()
        raise click.exceptions.Exit(1) from None
