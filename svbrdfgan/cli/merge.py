"""`svbrdfgan dataset merge`: one data set of the shards that several processes or machines made."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import echo, progress


@click.command("merge")
@click.argument("folders", nargs=-1, required=True, metavar="DIR...", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "-o", "--out", type=click.Path(path_type=Path, file_okay=False), help="Folder to write, which must not exist."
)
@click.option("--pack", "packed", is_flag=True, help="Pack the exemplars into tar files of 10,000 each.")
def command(folders: tuple[Path, ...], out: Path | None, packed: bool) -> None:
    """Check that all shards of a data set are there, and make one data set of them.

    One DIR, into which all shards were written, is completed in place. Several are copied into one by -o. The result
    has the same files as `svbrdfgan dataset CONFIG` on one machine makes; with --pack, in fewer and larger ones.
    """
    in_place = packed and out is None
    kept = f"{'no exemplar is lost' if in_place else 'the shards are as they were'}, and the same command merges them."
    with progress("looking for the exemplars", lambda: kept) as display:
        from svbrdfgan.data.merge import merge_shards

        index = merge_shards(folders, out, packed=packed, display=display)
    for split in index.config.splits:
        echo(f"{split}: {len(index.sampler(split))} exemplars of {len(index.meshes[split])} meshes")
