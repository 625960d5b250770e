"""`svbrdfgan texture`: weathers mesh files with a trained generator."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import click

from svbrdfgan.cli.display import note, progress
from svbrdfgan.cli.options import (
    DENSITY,
    PartOptions,
    check_delivery,
    completed,
    delivery_options,
    device_option,
    json_option,
    known_models,
    part_options,
    picture_options,
    studio_of,
)
from svbrdfgan.cli.results import Done, results
from svbrdfgan.models.shipped import DEFAULT, model_of
from svbrdfgan.utils.devices import Device

_MOST_LAYERS = 10_000


@click.command("texture")
@click.argument("meshes", metavar="MESH...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--model",
    metavar="NAME|FOLDER",
    help="A shipped model (see `svbrdfgan models`) or the folder of a training run.  "
    "[default: the shipped one that learned --recipe, or else road-dirt]",
    shell_complete=completed(known_models, "dir"),
)
@click.option("--seed", type=int, help="Each seed gives another pattern; for models with random fields.  [default: 0]")
@click.option("--amount", type=float, help="0 is clean, 1 is filthy.  [default: the middle of those trained on]")
@click.option("--recipe", help="One of those that the model was trained on; needed if --model knows several.")
@click.option(
    "--resolution",
    type=int,
    help="Texels along a side of the layer: a multiple of those trained at; patterns keep their scale.  "
    "[default: those trained at]",
)
@click.option(
    "--count",
    type=click.IntRange(1, _MOST_LAYERS),
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
@device_option
@json_option("for each mesh an object with the paths written")
@delivery_options
@picture_options
def command(
    meshes: tuple[Path, ...],
    model: str | None,
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
    force: bool,
    embedding_uvs: bool,
    picture: Path | None,
    environment: Path | None,
    renderer: str,
    device: Device,
    as_json: bool,
) -> None:
    """Weather each MESH with a trained model: its scene comes back, only what weathers has other textures."""
    check_delivery(meshes, parts, click.get_current_context().params)
    if count is not None and picture is not None:
        raise click.UsageError("--picture is of one layer; leave out --count.")
    first = seed or 0
    seeds = [seed] if count is None else list(range(first, first + count))
    paths = results(meshes, out, force=force, draws=None if count is None else [str(number) for number in seeds])
    asked = model or recipe
    if model is None:
        recipe = recipe or DEFAULT
        model = model_of(recipe)
    done = Done(meshes)
    with progress(f"loading {model}", done.kept) as display:
        from svbrdfgan.inference.learned import LearnedWeathering
        from svbrdfgan.rendering.compositing import BARE
        from svbrdfgan.report.sheet import sheet_rows
        from svbrdfgan.training.run import load_model

        trained, name = load_model(model).on(device), Path(model).name
        if not asked:
            note(f"painting {DEFAULT}; --recipe and --model choose another (see `svbrdfgan models`)")
        draws = [
            LearnedWeathering.of(trained, name=name, seed=number, amount=amount, recipe=recipe, resolution=resolution)
            for number in seeds
        ]
        rows = [] if sheet is None else sheet_rows(trained, seed=seed, amount=amount, recipe=recipe)
        maps = trained.config.maps
        studio = studio_of(
            {"--picture": picture, "--sheet": sheet}, environment, renderer, maps if embedding_uvs else BARE
        )
        if embedding_uvs:
            from svbrdfgan.cli.embedded import Embedded

            layers = Embedded(display, parts, maps, studio, picture)
            done.each_alone(lambda k: layers.texture(meshes[k], paths[k], draws, rows, sheet))
        else:
            from svbrdfgan.asset.weather_document import Textures
            from svbrdfgan.cli.scenes import Scenes
            from svbrdfgan.inference.apply import prepare
            from svbrdfgan.report.sheet import write_sheet

            textures = Textures(size, max(DENSITY, resolution or 0))
            scenes = Scenes(display, textures, maps_folder, variants, overlay, parts)

            def work(number: int) -> Iterator[Path]:
                workpiece = scenes.open(meshes[number], draws[0].settles_on)
                for path, draw in zip(paths[number], draws, strict=True):
                    yield from scenes.write(workpiece, draw, path, studio, picture)
                if sheet is not None and studio is not None:
                    display.stage(f"embedding {meshes[number]} for {sheet}")
                    canvas = prepare(workpiece.mesh, trained, workpiece.selection, resolution)
                    write_sheet(sheet, rows, canvas.thinned(draws[0].shares(workpiece)), studio, maps, display=display)
                    yield sheet

            done.each_alone(work)
    done.report(as_json=as_json)
