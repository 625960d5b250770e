"""`svbrdfgan dataset import`: a data set of the user's own pictures (thesis 6.2)."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import read_config

if TYPE_CHECKING:
    from svbrdfgan.data.photos.build import ImportedPicture


@click.command("import")
@click.argument("manifest", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option(
    "--workers",
    type=click.IntRange(1),
    help="Processes that share the pictures.  [default: one for each core, at most 8]",
)
@click.option("--preview", is_flag=True, help="Check everything, draw each mesh over its picture, and stop.")
def command(manifest: Path, overrides: tuple[str, ...], out: Path, workers: int | None, preview: bool) -> None:
    """Make a data set of the pictures that MANIFEST names, each with its mesh and an approximate camera.

    Pictures that cannot be used are left out, each with a warning. Of other errors all are listed, and nothing is
    written. KEY=VALUE replaces a value of MANIFEST.
    """
    kept = "nothing was written, and the same command imports all pictures again."
    with progress(f"reading {manifest}", lambda: kept) as display:
        from svbrdfgan.data.photos.build import OVERLAYS, SHEET, import_pictures
        from svbrdfgan.data.photos.manifest import read_manifest

        contents = read_manifest(read_config(manifest, overrides), str(manifest))
        imported = import_pictures(
            contents,
            out,
            base=manifest.parent,
            source=str(manifest),
            preview=preview,
            workers=workers,
            display=display,
        )
    for picture in imported:
        _print(picture)
    echo(f"look at {out / OVERLAYS / SHEET}: does the mesh's outline (yellow) lie on every picture?")
    if not preview:
        for split in contents.config().splits:
            count = sum(picture.exemplar.startswith(f"{split}/") for picture in imported)
            echo(f"{split}: {count} exemplars of {len(contents.meshes(split))} meshes")


def _print(picture: ImportedPicture) -> None:
    agreement = "no mask" if picture.iou is None else f"IoU {picture.iou:.2f}"
    if (moved := picture.refinement) is not None:
        agreement += f" (was {moved.before:.2f}; camera changed by {moved.degrees:.1f} degrees, {moved.percent:.1f} %)"
    exposure = "" if picture.exposure is None else f", exposure x {picture.exposure:.3g}"
    within = "" if picture.uncertainty is None else f", reflectance within {math.expm1(picture.uncertainty):.0%}"
    echo(f"{picture.overlay}: {picture.file}: {agreement}{exposure}{within}")
    for doubt in picture.doubts:
        echo(f"warning: {picture.file}: {doubt} (see {picture.overlay})", err=True)
