"""`svbrdfgan texture`: weathers mesh files with a trained generator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import progress
from svbrdfgan.cli.options import (
    PartOptions,
    check_overlay,
    delivery_options,
    each_alone,
    part_options,
    picture_options,
    results,
    studio_of,
)

if TYPE_CHECKING:
    from svbrdfgan.cli.display import ProgressBar, ProgressLines
    from svbrdfgan.inference.learned import LearnedWeathering
    from svbrdfgan.inference.studio import Studio
    from svbrdfgan.report.sheet import Row
    from svbrdfgan.training.run import Model

_DENSITY = 1024
"""Texels along a side of a texture over the whole model: at that density, at least, layers are carried to UVs."""


@click.command("texture")
@click.argument("meshes", metavar="MESH...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--model", "run", required=True, type=click.Path(path_type=Path), help="Folder of a training run.")
@click.option("--seed", type=int, help="Each seed gives another pattern; for models with random fields.  [default: 0]")
@click.option("--amount", type=float, help="0 is clean, 1 is filthy.  [default: the middle of those trained on]")
@click.option("--recipe", help="One of those that the model was trained on; needed if it knows several.")
@click.option(
    "--resolution",
    type=int,
    help="Texels along a side of the layer: a multiple of those trained at; patterns keep their scale.  "
    "[default: those trained at]",
)
@click.option(
    "--count",
    type=click.IntRange(min=1),
    help="Number of layers, of this seed and the next ones. OUT is then a folder; files are named after mesh and seed.",
)
@click.option(
    "--sheet",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Also render draws, amounts and recipes side by side, to a .png or .jpg file.",
)
@part_options
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path),
    help="GLB or glTF file to write; of several MESHes or with --count, a folder.",
)
@delivery_options
@picture_options
def command(
    meshes: tuple[Path, ...],
    run: Path,
    seed: int | None,
    amount: float | None,
    recipe: str | None,
    resolution: int | None,
    count: int | None,
    sheet: Path | None,
    parts: PartOptions,
    out: Path,
    size: int | None,
    maps_folder: Path | None,
    variants: bool,
    overlay: Path | None,
    memory: int | None,
    force: bool,
    embedding_uvs: bool,
    picture: Path | None,
    environment: Path | None,
    renderer: str,
) -> None:
    """Weather each MESH with the generator of a run: its scene comes back, only what weathers has other textures."""
    if len(meshes) > 1 and (picture is not None or sheet is not None):
        raise click.UsageError("--picture and --sheet are of one MESH.")
    if count is not None and picture is not None:
        raise click.UsageError("--picture is of one layer; leave out --count.")
    check_overlay(
        meshes,
        overlay,
        maps=maps_folder,
        variants=variants,
        picture=picture,
        sheet=sheet,
        count=count,
        embedding_uvs=embedding_uvs,
    )
    first = seed or 0
    seeds = [seed] if count is None else list(range(first, first + count))
    paths = results(meshes, out, force=force, draws=None if count is None else [str(number) for number in seeds])
    with progress(f"loading {run}") as display:
        from svbrdfgan.inference.learned import LearnedWeathering
        from svbrdfgan.rendering.compositing import BARE
        from svbrdfgan.report.sheet import sheet_rows
        from svbrdfgan.training.run import load_model

        model = load_model(run)
        draws = [
            LearnedWeathering.of(model, name=run.name, seed=number, amount=amount, recipe=recipe, resolution=resolution)
            for number in seeds
        ]
        rows = [] if sheet is None else sheet_rows(model, seed=seed, amount=amount, recipe=recipe)
        maps = model.config.maps
        studio = studio_of(
            {"--picture": picture, "--sheet": sheet}, environment, renderer, maps if embedding_uvs else BARE
        )
        if embedding_uvs:
            layers = _Embedded(display, model, draws, resolution, parts)
            done = each_alone(meshes, lambda k: layers.write(meshes[k], paths[k], studio, picture, rows, sheet))
        else:
            from svbrdfgan.asset.weather_document import Textures
            from svbrdfgan.cli.scenes import Scenes
            from svbrdfgan.inference.apply import prepare
            from svbrdfgan.report.sheet import write_sheet

            textures = Textures(size, max(_DENSITY, resolution or 0))
            scenes = Scenes(display, textures, maps_folder, variants, overlay, memory, parts)

            def work(number: int) -> list[Path]:
                workpiece = scenes.open(meshes[number])
                written: list[Path] = []
                for path, draw in zip(paths[number], draws, strict=True):
                    written += scenes.write(workpiece, draw, path, studio, picture)
                if sheet is not None and studio is not None:
                    display.stage(f"writing {sheet}")
                    canvas = prepare(workpiece.mesh, model, workpiece.selection, resolution)
                    write_sheet(sheet, rows, canvas, studio, maps)
                    written.append(sheet)
                return written

            done = each_alone(meshes, work)
    done.report()


@dataclass(frozen=True)
class _Embedded:
    """Weathering over the UVs of the model's embedding."""

    display: ProgressBar | ProgressLines
    model: Model
    draws: Sequence[LearnedWeathering]
    resolution: int | None
    parts: PartOptions

    def write(
        self,
        mesh: Path,
        paths: Sequence[Path],
        studio: Studio | None,
        picture: Path | None,
        rows: Sequence[Row],
        sheet: Path | None,
    ) -> list[Path]:
        from svbrdfgan.cli.embedded import report_embedded, selection, write_embedded_files
        from svbrdfgan.inference.apply import explain_memory, prepare
        from svbrdfgan.io.mesh import load_mesh
        from svbrdfgan.report.sheet import write_sheet

        self.display.stage(f"weathering {mesh}")
        maps = self.model.config.maps
        with explain_memory(self.resolution):
            canvas = prepare(load_mesh(mesh), self.model, selection(self.parts), self.resolution)
            report_embedded(canvas.subject)
            written = []
            for path, draw in zip(paths, self.draws, strict=True):
                layer = canvas.paint(draw.draw)
                self.display.stage(f"writing {path}")
                written += write_embedded_files(path, canvas.subject, layer, maps, studio, picture)
            if sheet is not None and studio is not None:
                self.display.stage(f"writing {sheet}")
                write_sheet(sheet, rows, canvas, studio, maps)
                written.append(sheet)
        return written
