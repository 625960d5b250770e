"""`svbrdfgan weather`: weathers a mesh by one of the procedural recipes (G0)."""

from __future__ import annotations

from pathlib import Path

import click

from svbrdfgan.cli.display import progress
from svbrdfgan.cli.options import (
    key_values,
    learnable_option,
    picture_options,
    report_weathered,
    require_apart,
    selected,
    studio_maker,
    writer,
)


@click.command("weather")
@click.argument("mesh", type=click.Path(path_type=Path))
@click.option("--recipe", default="road-dirt", show_default=True, help="road-dirt, dust, rust or chipped-paint.")
@click.option("--amount", default=1.0, show_default=True, type=click.FloatRange(0, 1), help="0 is clean.")
@click.option("--seed", default=0, show_default=True, help="Each seed gives another pattern.")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the recipe; repeatable.")
@click.option(
    "--map",
    "maps",
    multiple=True,
    metavar="NAME=BARE",
    help="The value of this map on the bare surface, such as roughness=0.3 or normal=0 (flat); repeatable. Maps that "
    "are not named are left out. By default all are weathered, from the file's own values.",
)
@click.option("--base-color-only", is_flag=True, help="Weather base colour alone; gloss, relief and alpha are dropped.")
@click.option("--embedding", default="hemispherical", show_default=True, help="See `svbrdfgan embeddings`.")
@learnable_option
@click.option(
    "--resolution", default=512, show_default=True, type=click.IntRange(16, 8192), help="Texels along a side."
)
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help="GLB file to write.")
@picture_options
def command(
    mesh: Path,
    recipe: str,
    amount: float,
    seed: int,
    options: tuple[str, ...],
    maps: tuple[str, ...],
    base_color_only: bool,
    embedding: str,
    learnable: tuple[str, ...],
    resolution: int,
    out: Path,
    picture: Path | None,
    environment: Path | None,
    renderer: str,
) -> None:
    """Weather MESH by a recipe; write it as GLB, and the layer and each map as PNG next to it."""
    require_apart(mesh, out)
    if maps and base_color_only:
        raise click.UsageError("--map and --base-color-only exclude each other.")
    with progress(f"loading {mesh}") as display:
        from svbrdfgan.config.choices import PartSelection
        from svbrdfgan.io.mesh import load_mesh
        from svbrdfgan.plugins.registry import load_embedding
        from svbrdfgan.rendering.compositing import BARE
        from svbrdfgan.scene.description import map_values
        from svbrdfgan.scene.subject import make_subject
        from svbrdfgan.weathering.layer import recipe_from_options, weather

        bare: dict[str, float | None] = {**map_values(key_values(maps), "--map")}
        if not maps and not base_color_only:
            bare = dict.fromkeys(BARE)
        chosen = recipe_from_options(recipe, {"amount": amount, "seed": seed, **key_values(options)})
        studio = studio_maker({"--picture": picture}, environment, renderer, bare)
        write = writer(out, picture, studio, bare)
        loaded = load_mesh(mesh)
        display.stage(f"unwrapping {mesh}")
        parts = selected(learnable) or PartSelection()
        subject = make_subject(loaded, load_embedding(embedding), resolution, parts, file_maps=bool(bare))
        display.stage(f"weathering {mesh}")
        layer = weather(subject.surface, subject.buffer, chosen, bare)
        display.stage(f"writing {out}")
        written = write(subject, layer)
    report_weathered(subject, written)
