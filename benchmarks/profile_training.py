"""Where a training step spends its time: milliseconds of a step, and of the operations that take most of it.

    python benchmarks/profile_training.py train.yaml [KEY=VALUE]...

The configuration is that of `svbrdfgan train`; a data set of some twenty pictures is enough. Nothing is written.
"""

from __future__ import annotations

import time
from pathlib import Path

import click
import torch
from torch.profiler import ProfilerActivity, profile

from svbrdfgan.cli.options import read_config
from svbrdfgan.plugins.select import resolve_renderer
from svbrdfgan.training.batches import make_batch_source
from svbrdfgan.training.config import train_config
from svbrdfgan.training.resolve import make_fabric, resolve_run
from svbrdfgan.training.run import RunConfig
from svbrdfgan.training.state import State
from svbrdfgan.training.step import batch_indices, training_step


@click.command()
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option(
    "--steps", default=20, show_default=True, help="Steps that are timed, and then as many that are profiled."
)
@click.option("--rows", default=40, show_default=True, help="Operations that are listed.")
def main(config: Path, overrides: tuple[str, ...], steps: int, rows: int) -> None:
    resolved = resolve_run(train_config(read_config(config, overrides), str(config)), config.parent)
    training, record = resolved.config, RunConfig.of(resolved)
    fabric = make_fabric(training.device, precision=training.precision)
    cuda = fabric.device.type == "cuda"
    renderer, _ = resolve_renderer(
        training.renderer, fabric.device, record.maps, differentiable=True, deferred=resolved.deferred
    )
    source = make_batch_source(resolved, "train", renderer, fabric.device)
    state = State.fresh(training, fabric.device, tuple(record.dataset.maps), 1, record.conditions.size)

    def step() -> None:
        indices = batch_indices(training.seed, len(source), training.batch_size, state.step)
        training_step(fabric, training, state, source, [indices])

    def run() -> float:
        began = time.perf_counter()
        for _ in range(steps):
            step()
        if cuda:
            torch.cuda.synchronize()
        return (time.perf_counter() - began) / steps

    run()  # which compiles kernels
    seconds = run()
    click.echo(f"{1e3 * seconds:.1f} ms a step, {training.batch_size / seconds:.0f} images/s")
    activities = [ProfilerActivity.CPU, *([ProfilerActivity.CUDA] if cuda else [])]
    with profile(activities=activities) as profiled:
        run()
    order = "self_device_time_total" if cuda else "self_cpu_time_total"
    click.echo(profiled.key_averages().table(sort_by=order, row_limit=rows, max_name_column_width=60))


if __name__ == "__main__":
    main()
