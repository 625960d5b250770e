"""`svbrdfgan dataset photograph`: the scenes of a data set as Blender's Cycles sees them, as photographs to import."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import read_config


@click.command("photograph")
@click.argument("config", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option(
    "--blender", metavar="PROGRAM", help="A Blender, or a Python with the package bpy.  [default: the one that is here]"
)
@click.option("--jobs", default=1, show_default=True, type=click.IntRange(1), help="Blenders at a time.")
@click.option("--truth", is_flag=True, help="Render the exemplars of OUT/truth, too.")
def command(config: Path, overrides: tuple[str, ...], out: Path, blender: str | None, jobs: int, truth: bool) -> None:
    """Photograph the training scenes of the data set that the YAML file CONFIG describes, in Blender's Cycles.

    OUT gets JPEG files and masks, the clean meshes, and a manifest for `svbrdfgan dataset import`, whose cameras are
    somewhat wrong. OUT/truth is the data set of the same scenes, and holds the truth of each photograph. Run again, it
    takes what is missing. KEY=VALUE replaces a value of CONFIG.
    """
    kept = f"{out} keeps the photographs that are complete, and the same command takes the others."
    with progress(f"reading {config}", lambda: kept) as display:
        from svbrdfgan.data.generate import generate
        from svbrdfgan.data.staged_photos.config import staged_photos_config
        from svbrdfgan.data.staged_photos.stage import TRUTH, stage_photos

        staged = staged_photos_config(read_config(config, overrides), str(config))
        manifest = stage_photos(staged, out, base=config.parent, blender=blender, jobs=jobs, display=display)
        if truth:
            generate(staged.dataset, out / TRUTH, base=config.parent, display=display)
    echo(f"next: svbrdfgan learn {manifest} train.yaml -o RUN")
