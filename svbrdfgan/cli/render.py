"""`svbrdfgan render`: a stored scene as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from svbrdfgan.cli.options import key_values

if TYPE_CHECKING:
    from svbrdfgan.scene.description import Scene


@click.command("render")
@click.argument("scene", type=click.Path(path_type=Path))
@click.option("-o", "--out", required=True, type=click.Path(path_type=Path, dir_okay=False), help=".png, .jpg or .exr")
@click.option("--renderer", default=None, help="See `svbrdfgan backends`; the scene's own otherwise.")
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="An option of the renderer; repeatable.")
@click.option("--spp", default=None, type=click.IntRange(1), help="Samples per pixel; the scene's own otherwise.")
@click.option("--assets", default=None, type=click.Path(path_type=Path), help="What asset paths are relative to.")
def command(
    scene: Path, out: Path, renderer: str | None, options: tuple[str, ...], spp: int | None, assets: Path | None
) -> None:
    """Render SCENE, a JSON file as stored beside each exemplar. EXR keeps coverage as alpha; PNG has it transparent."""
    import torch

    from svbrdfgan.config.choices import PluginChoice
    from svbrdfgan.data.generate import render_scene, save_exemplar
    from svbrdfgan.io import save_image
    from svbrdfgan.plugins.select import resolve_renderer
    from svbrdfgan.scene.description import Scene
    from svbrdfgan.scene.loader import SceneLoader

    if options and renderer is None:
        raise click.UsageError("--option is of --renderer: name one.")
    described = Scene.load(scene)
    chosen = described.renderer if renderer is None else PluginChoice(name=renderer, options=key_values(options))
    described = described.model_copy(update={"spp": spp or described.spp})
    loader = SceneLoader(assets or _asset_folder(scene, described), keep=False)
    rendering = render_scene(loader, resolve_renderer(chosen, maps=described.maps)[0], described)
    if out.suffix.lower() == ".exr":
        save_exemplar(out, rendering)
    elif out.suffix.lower() in (".jpg", ".jpeg"):
        save_image(out, rendering.image.cpu())
    else:
        coverage = rendering.coverage.cpu().unsqueeze(-1)
        straight = rendering.image.cpu() / coverage.clamp(min=1e-6)
        save_image(out, torch.cat([straight, coverage], dim=-1))
    click.echo(str(out))


def _asset_folder(path: Path, scene: Scene) -> Path:
    """The nearest folder above the scene file in which its mesh is found; its own folder if there is none."""
    folders = [path.parent, *path.resolve().parent.parents]
    return next((folder for folder in folders if (folder / scene.mesh.path).is_file()), path.parent)
