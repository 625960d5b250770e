"""`svbrdfgan weather`: weathers mesh files by one of the procedural recipes (G0)."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import progress
from svbrdfgan.cli.options import (
    PartOptions,
    check_delivery,
    delivery_options,
    json_option,
    key_values,
    part_options,
    picture_options,
    studio_of,
)
from svbrdfgan.cli.results import Done, results

_DENSITY, _EMBEDDED = 2048, 512
_RECIPES = "road-dirt, dust, rust, chipped-paint or grime; for laboratories smooth-dirt, -dust, -rust or -chips"
_OPTIONS = """\b
Options of recipes, for --option:
  all             scale, relief
  road-dirt       reach, spray, runs
  dust            drops
  rust            bleed
  chipped-paint   scratches, rust
  grime           streaks
  smooth-dirt     reach, spray, detail
  smooth-dust     cling, detail
  smooth-rust     bleed, detail
  smooth-chips    scratches, rust, detail
"""


@click.command("weather", epilog=_OPTIONS)
@click.argument("meshes", metavar="MESH...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--recipe", default="road-dirt", show_default=True, help=f"{_RECIPES}.")
@click.option("--amount", type=click.FloatRange(0, 1), help="0 is clean.  [default: the recipe's]")
@click.option("--seed", default=0, show_default=True, help="Each seed gives another pattern.")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the recipe; repeatable.")
@click.option("--base-color-only", is_flag=True, help="Weather base colour alone; gloss and relief stay.")
@part_options
@click.option(
    "--resolution",
    type=click.IntRange(16, 8192),
    help="The layer is as fine as a texture of that many texels along a side over the whole model.  "
    f"[default: {_DENSITY}; with --embedding-uvs {_EMBEDDED}]",
)
@click.option(
    "-o", "--out", required=True, type=click.Path(path_type=Path), help="GLB or glTF file; of several MESHes a folder."
)
@json_option("for each mesh an object with the paths written")
@delivery_options
@click.option("--embedding", help="With --embedding-uvs: see `svbrdfgan embeddings`.  [default: hemispherical]")
@click.option(
    "--map",
    "bare",
    multiple=True,
    metavar="NAME=BARE",
    help="With --embedding-uvs: the value of this map on the bare surface, such as roughness=0.3 or normal=0 (flat); "
    "repeatable. Maps that are not named are left out.  [default: all, from the file's own values]",
)
@picture_options
def command(
    meshes: tuple[Path, ...],
    recipe: str,
    amount: float | None,
    seed: int,
    options: tuple[str, ...],
    base_color_only: bool,
    resolution: int | None,
    out: Path,
    force: bool,
    embedding_uvs: bool,
    embedding: str | None,
    bare: tuple[str, ...],
    picture: Path | None,
    environment: Path | None,
    renderer: str,
    as_json: bool,
    parts: PartOptions,
    size: int | None,
    maps_folder: Path | None,
    variants: bool,
    overlay: Path | None,
) -> None:
    """Weather each MESH by a recipe: its scene comes back, and only the textures of what weathers differ."""
    check_delivery(meshes, parts, click.get_current_context().params)
    if (bare or embedding) and not embedding_uvs:
        raise click.UsageError("--embedding and --map need --embedding-uvs.")
    if bare and base_color_only:
        raise click.UsageError("--map and --base-color-only exclude each other.")
    paths = results(meshes, out, force=force)
    done = Done(meshes)
    with progress(f"loading {meshes[0]}", done.kept) as display:
        from svbrdfgan.rendering.compositing import BARE
        from svbrdfgan.scene.description import map_values
        from svbrdfgan.weathering.layer import recipe_from_options

        asked = {} if amount is None else {"amount": amount}
        chosen = recipe_from_options(recipe, {**asked, "seed": seed, **key_values(options)})
        maps = {**map_values(key_values(bare), "--map")} if bare or base_color_only else dict.fromkeys(BARE)
        studio = studio_of(
            {"--picture": picture}, environment, renderer, maps if embedding_uvs else dict.fromkeys(BARE)
        )
        if embedding_uvs:
            from svbrdfgan.cli.embedded import Embedded

            given = embedding or "hemispherical"
            layers = Embedded(display, parts, maps, studio, picture)
            done.each_alone(lambda k: layers.weather(meshes[k], paths[k][0], chosen, given, resolution or _EMBEDDED))
        else:
            from svbrdfgan.asset.weather_document import Textures
            from svbrdfgan.cli.scenes import Scenes
            from svbrdfgan.inference.weatherings import RecipeWeathering

            textures = Textures(size, resolution or _DENSITY)
            scenes = Scenes(display, textures, maps_folder, variants, overlay, parts)
            weathering = RecipeWeathering(chosen, tuple(maps))
            done.each_alone(
                lambda k: scenes.write(
                    scenes.open(meshes[k], chosen.settles_on), weathering, paths[k][0], studio, picture
                )
            )
    done.report(as_json=as_json)
