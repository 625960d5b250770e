"""`svbrdfgan texture`: a mesh under a trained generator."""

from __future__ import annotations

from pathlib import Path

import click


@click.command("texture")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.option("--model", "run", required=True, type=click.Path(path_type=Path), help="Folder of a training run.")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="GLB to write.")
def command(mesh: Path, run: Path, out: Path) -> None:
    """Weather MESH with the generator of a run; write it as GLB, and the layer by itself as PNG beside it."""
    from svbrdfgan.apply import paint
    from svbrdfgan.export import write_weathered
    from svbrdfgan.io import load_mesh
    from svbrdfgan.training.run import load_model

    model = load_model(run)
    subject, layer = paint(load_mesh(mesh), model)
    alone = write_weathered(out, subject, layer, model.config.maps)
    click.echo(f"{out}\n{alone}")
