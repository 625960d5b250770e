"""`svbrdfgan dataset pose`: the cameras of the user's own pictures, by COLMAP."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import echo, progress

if TYPE_CHECKING:
    from svbrdfgan.data.photos.pose import PosedPictures


@click.command("pose")
@click.argument("images", type=click.Path(path_type=Path, file_okay=False))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, file_okay=False), help="Folder to write.")
@click.option(
    "--masks",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder with a mask of each picture, white where the object is; needed if it stood on a turntable.",
)
def command(images: Path, out: Path, masks: Path | None) -> None:
    """Find the cameras of the pictures in the folder IMAGES by COLMAP, and write its model into OUT.

    A manifest names OUT as `cameras` of a capture, for `svbrdfgan dataset import`. Pictures are PNG or JPEG; those of
    one size share a camera, so do not zoom. A mask has its picture's name, with the suffix replaced or followed by
    `.png`.
    """
    with progress(f"looking into {images}") as display:
        from svbrdfgan.data.photos.pose import pose_pictures

        posed = pose_pictures(images, out, masks, display)
    echo(f"{out}: {_sentence(posed)}")


def _sentence(posed: PosedPictures) -> str:
    count = len(posed.placed) + len(posed.others)
    placed = (
        f"{len(posed.placed)} of {count} pictures placed, with a mean reprojection error of {posed.error:.2f} pixels"
    )
    return f"{placed}; not placed: {', '.join(posed.others)}" if posed.others else placed
