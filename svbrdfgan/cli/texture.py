"""`svbrdfgan texture`: a mesh under a trained generator."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.options import learnable_option, require_apart, selected
from svbrdfgan.cli.weathered import picture_options, writer


@click.command("texture")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.option("--model", "run", required=True, type=click.Path(path_type=Path), help="Folder of a training run.")
@learnable_option
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="GLB to write.")
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
    """Weather MESH with the generator of a run; write it as GLB, and the layer by itself as PNG beside it."""
    from svbrdfgan.inference.apply import paint
    from svbrdfgan.io import load_mesh
    from svbrdfgan.training.run import load_model

    require_apart(mesh, out)
    model = load_model(run)
    write = writer(out, picture, environment, renderer, model.config.maps)
    write(*paint(load_mesh(mesh), model, selected(learnable)))
