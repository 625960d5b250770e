"""`svbrdfgan render`: a stored scene as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.display import echo, progress
from svbrdfgan.cli.options import key_values, memory_option

if TYPE_CHECKING:
    from svbrdfgan.scene.description import Scene
    from svbrdfgan.types import Rendering


@click.command("render")
@click.argument("scene", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--out",
    required=True,
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture to write: .png, .jpg or .exr.",
)
@click.option("--renderer", help="See `svbrdfgan backends`.  [default: the scene's own]")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of --renderer; repeatable.")
@click.option("--spp", type=click.IntRange(1), help="Samples per pixel.  [default: the scene's own]")
@memory_option
@click.option(
    "--assets",
    type=click.Path(path_type=Path),
    help="Folder that the scene's paths start from.  [default: the nearest above SCENE that holds its mesh]",
)
def command(
    scene: Path, out: Path, renderer: str | None, options: tuple[str, ...], spp: int | None, assets: Path | None
) -> None:
    """Render SCENE, the JSON file of an exemplar. EXR keeps coverage as alpha; PNG is transparent around the mesh."""
    if options and renderer is None:
        raise click.UsageError("--option is an option of --renderer: name the renderer.")
    with progress(f"loading {scene}") as display:
        from svbrdfgan.config.choices import PluginChoice
        from svbrdfgan.config.models import validate
        from svbrdfgan.data.generate import render_scene
        from svbrdfgan.plugins.select import resolve_renderer
        from svbrdfgan.rendering.picture_memory import require_picture
        from svbrdfgan.scene.description import Scene
        from svbrdfgan.scene.loader import SceneLoader

        described = Scene.load(scene)
        chosen = described.renderer if renderer is None else PluginChoice(name=renderer, options=key_values(options))
        if spp is not None:
            described = validate(Scene, described.model_dump() | {"spp": spp}, str(scene))
        require_picture(described.width, described.height, described.texture, out.suffix)
        loader = SceneLoader(assets or _asset_folder(scene, described), keep=False)
        resolved, _ = resolve_renderer(chosen, maps=described.maps)
        display.stage(f"rendering {scene}")
        _save(out, render_scene(loader, resolved, described))
    echo(str(out))


def _save(path: Path, rendering: Rendering) -> None:
    """Writes the picture by its suffix: premultiplied EXR, JPEG on black, else straight alpha."""
    import torch

    from svbrdfgan.data.exemplar_files import save_exemplar
    from svbrdfgan.io.image import save_image

    if path.suffix.lower() == ".exr":
        save_exemplar(path, rendering)
    elif path.suffix.lower() in (".jpg", ".jpeg"):
        save_image(path, rendering.image.cpu())
    else:
        coverage = rendering.coverage.cpu().unsqueeze(-1)
        straight = rendering.image.cpu() / coverage.clamp(min=1e-6)  # black where nothing is covered
        save_image(path, torch.cat([straight, coverage], dim=-1))


def _asset_folder(path: Path, scene: Scene) -> Path:
    """The nearest folder above the scene file in which its mesh is found; the file's own folder if there is none."""
    folders = [path.parent, *path.resolve().parent.parents]
    return next((folder for folder in folders if (folder / scene.mesh.path).is_file()), path.parent)
