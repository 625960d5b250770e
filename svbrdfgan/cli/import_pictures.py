"""`svbrdfgan dataset import`: a data set of the user's own pictures (thesis 6.2)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from svbrdfgan.data.photos.build import ImportedPicture


@click.command("import")
@click.argument("manifest", type=click.Path(path_type=Path, dir_okay=False))
@click.argument("overrides", nargs=-1, metavar="[KEY=VALUE]...")
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option("--preview", is_flag=True, help="Check everything, draw the overlays of mesh and picture, and stop.")
def command(manifest: Path, overrides: tuple[str, ...], out: Path, preview: bool) -> None:
    """Make a data set of the pictures that MANIFEST names, each with its mesh and an approximate camera.

    All faults are told at once, and then nothing is written. KEY=VALUE replaces a value of MANIFEST.
    """
    from rich.console import Console

    from svbrdfgan.cli.display import terminal_display
    from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
    from svbrdfgan.data.photos.build import OVERLAYS, SHEET, import_pictures
    from svbrdfgan.data.photos.manifest import read_manifest

    declared = read_manifest(apply_overrides(load_yaml(manifest), overrides), str(manifest))
    with terminal_display(Console(stderr=True)) as display:
        told = import_pictures(
            declared, out, base=manifest.parent, source=str(manifest), preview=preview, display=display
        )
    for one in told:
        _tell(one)
    click.echo(f"look at {out / OVERLAYS / SHEET}: does the mesh's outline (yellow) lie on every picture?")
    if not preview:
        for split in declared.config().splits:
            meshes = declared.meshes(split)
            count = sum(entry.mesh in meshes for entry in declared.pictures)
            click.echo(f"{split}: {count} exemplars of {len(meshes)} meshes")


def _tell(one: ImportedPicture) -> None:
    agreed = "no mask" if one.iou is None else f"IoU {one.iou:.2f}"
    exposed = "" if one.exposure is None else f", exposure x {one.exposure:.3g}"
    click.echo(f"{one.overlay}: {one.file}: {agreed}{exposed}")
    for doubt in one.doubts:
        click.echo(f"warning: {one.file}: {doubt} (see {one.overlay})", err=True)
