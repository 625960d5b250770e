"""`svbrdfgan parts`: which parts of a mesh weather, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.markup import escape
from rich.table import Table

from svbrdfgan.cli.display import echo, note, print_json, print_table, progress
from svbrdfgan.cli.options import PartOptions, json_option, memory_option, part_options, require_writable

if TYPE_CHECKING:
    from svbrdfgan.asset.verdicts import Verdict


@click.command("parts")
@click.argument("mesh", type=click.Path(path_type=Path, dir_okay=False))
@part_options
@json_option("the verdicts and warnings as an object")
@click.option(
    "--picture",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also draw the mesh from four sides, coloured by verdict, to a .png or .jpg file.",
)
@memory_option
def command(
    mesh: Path,
    parts: PartOptions,
    as_json: bool,
    picture: Path | None,
) -> None:
    """Show which parts of MESH weather and which are kept, and why.

    Patterns such as 'body*' match names of materials, meshes and nodes, case ignored. --keep wins over all else.
    """
    if picture is not None and picture.suffix.lower() not in (".png", ".jpg", ".jpeg"):
        raise click.UsageError(f"--picture is {picture}; wanted a .png or .jpg file.")
    if picture is not None:
        require_writable(picture, picture.suffix.lower())
    with progress(f"loading {mesh}") as display:
        from svbrdfgan.asset.asset import load_asset
        from svbrdfgan.asset.masks import Mask, masked_pieces
        from svbrdfgan.asset.orientation import axes, find_orientation
        from svbrdfgan.asset.verdicts import judge, warnings

        front, up = axes(parts.front, parts.up)
        masks = [Mask.read(word) for word in parts.masks]
        asset = load_asset(mesh)
        display.stage(f"judging the parts of {mesh}")
        found = find_orientation(asset.mesh, front=front, up=up)
        masked = masked_pieces(asset, masks)
        verdicts = judge(asset, orientation=found.matrix(), learnable=parts.learnable, keep=parts.keep, masked=masked)
        doubts = warnings(verdicts, asset)
        if picture is not None:
            from svbrdfgan.report.part_views import write_part_views

            display.stage(f"drawing {picture}")
            write_part_views(picture, asset, verdicts, found.matrix())
    if as_json:
        report = {"orientation": asdict(found), "parts": [asdict(each) for each in verdicts], "warnings": doubts}
        print_json(report)
    else:
        print_table(_table(mesh, verdicts))
    note(str(found))
    for doubt in doubts:
        echo(f"warning: {doubt}", err=True)
    if picture is not None:
        echo(str(picture), err=as_json)


def _table(mesh: Path, verdicts: Sequence[Verdict]) -> Table:
    """One row for each name and verdict, the largest first."""
    rows: dict[tuple[str, str, bool, str], float] = {}
    for each in verdicts:
        key = (each.name, each.kind, each.weathers, each.reason + ("" if each.sure else " (not sure)"))
        rows[key] = rows.get(key, 0.0) + each.area
    weathered = sum(each.area for each in verdicts if each.weathers)
    table = Table("part", "kind", "verdict", "area", "why", title=f"{mesh.name}: {weathered:.0%} of the area weathers")
    for (name, kind, weathers, reason), area in sorted(rows.items(), key=lambda row: -row[1]):
        verdict = "[dark_orange]weathers[/]" if weathers else "[green]kept[/]"
        table.add_row(escape(name), kind, verdict, f"{area:.1%}", escape(reason))
    return table
