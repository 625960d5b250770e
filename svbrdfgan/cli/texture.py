"""`svbrdfgan texture`: weathers a mesh with a trained generator."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import progress
from svbrdfgan.cli.options import (
    learnable_option,
    picture_options,
    report_weathered,
    require_apart,
    selected,
    writer,
)


@click.command("texture")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.option("--model", "run", required=True, type=click.Path(path_type=Path), help="Folder of a training run.")
@learnable_option
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="GLB file to write.")
@picture_options
def command(
    mesh: Path,
    run: Path,
    learnable: tuple[str, ...],
    out: Path,
    picture: Path | None,
    environment: Path | None,
    renderer: str,
) -> None:
    """Weather MESH with the generator of a run; write it as GLB, and the layer alone as PNG beside it."""
    require_apart(mesh, out)
    with progress(f"loading {run}") as display:
        from svbrdfgan.inference.apply import paint
        from svbrdfgan.io import load_mesh
        from svbrdfgan.training.run import load_model

        model = load_model(run)
        write = writer(out, picture, environment, renderer, model.config.maps)
        display.stage(f"weathering {mesh}")
        subject, layer = paint(load_mesh(mesh), model, selected(learnable))
        display.stage(f"writing {out}")
        written = write(subject, layer)
    report_weathered(subject, written)
