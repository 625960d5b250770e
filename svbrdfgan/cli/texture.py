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
    studio_maker,
    writer,
)


@click.command("texture")
@click.argument("mesh", type=click.Path(path_type=Path))
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
@learnable_option
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), help="GLB file to write; with --count, a folder."
)
@picture_options
def command(
    mesh: Path,
    run: Path,
    seed: int | None,
    amount: float | None,
    recipe: str | None,
    resolution: int | None,
    count: int | None,
    sheet: Path | None,
    learnable: tuple[str, ...],
    out: Path,
    picture: Path | None,
    environment: Path | None,
    renderer: str,
) -> None:
    """Weather MESH with the generator of a run; write it as GLB, and the layer alone as PNG next to it."""
    if count is not None and picture is not None:
        raise click.UsageError("--picture is of one layer; leave out --count.")
    first = seed or 0
    seeds = [seed] if count is None else list(range(first, first + count))
    paths = [out] if count is None else [out / f"{mesh.stem}-{number}.glb" for number in seeds]
    for path in paths:
        require_apart(mesh, path)
    with progress(f"loading {run}") as display:
        from svbrdfgan.inference.apply import choose_draw, explain_memory, finer_factor, prepare
        from svbrdfgan.io.mesh import load_mesh
        from svbrdfgan.report.sheet import sheet_rows, write_sheet
        from svbrdfgan.training.run import load_model

        model = load_model(run)
        draws = [choose_draw(model, seed=number, amount=amount, recipe=recipe) for number in seeds]
        finer_factor(model, resolution)  # before anything is made or written
        rows = [] if sheet is None else sheet_rows(model, seed=seed, amount=amount, recipe=recipe)
        maps = model.config.maps
        studio = studio_maker({"--picture": picture, "--sheet": sheet}, environment, renderer, maps)
        writers = [writer(path, picture, studio, maps) for path in paths]
        display.stage(f"weathering {mesh}")
        with explain_memory(resolution):
            canvas = prepare(load_mesh(mesh), model, selected(learnable), resolution)
            written = []
            for path, draw, write in zip(paths, draws, writers, strict=True):
                layer = canvas.paint(draw)
                display.stage(f"writing {path}")
                written += write(canvas.subject, layer)
            if sheet is not None:
                display.stage(f"writing {sheet}")
                write_sheet(sheet, rows, canvas, studio(canvas.subject))
                written.append(sheet)
    report_weathered(canvas.subject, written)
