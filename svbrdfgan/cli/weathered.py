"""What `svbrdfgan weather` and `svbrdfgan texture` have in common: the files that they write, and `--picture`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import click

from svbrdfgan.cli.options import tell_parts

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from svbrdfgan.scene.asset import Subject

    Layer = Float[Tensor, "rows cols channels"]

Command = TypeVar("Command", bound=Callable[..., None])
_SKY = 7


def picture_options(command: Command) -> Command:
    """Adds `picture`, `environment` and `renderer` to a command's options."""
    path = click.Path(path_type=Path, dir_okay=False)
    for option in (
        click.option("--renderer", default="auto", show_default=True, help="With --picture: see `svbrdfgan backends`."),
        click.option("--environment", default=None, type=path, help="With --picture: HDR or EXR; else a clouded sky."),
        click.option("--picture", default=None, type=path, help="Render the mesh from two sides too: .png or .jpg."),
    ):
        command = option(command)
    return command


def writer(
    out: Path, picture: Path | None, environment: Path | None, renderer: str, maps: Mapping[str, float]
) -> Callable[[Subject, Layer], None]:
    """What writes and tells the files of a weathered mesh. What cannot work is refused at once."""
    _require_place(out, ".glb")
    photograph = _photographer(picture, environment, renderer, maps)

    def write(subject: Subject, layer: Layer) -> None:
        from svbrdfgan.inference.export import write_weathered

        written = [out, write_weathered(out, subject, layer, maps), *photograph(subject, layer)]
        tell_parts(subject)
        click.echo("\n".join(map(str, written)))

    return write


def _require_place(path: Path, *suffixes: str) -> None:
    """Refuses a file that could not be written, and makes its folder."""
    from svbrdfgan.errors import ConfigError

    if path.suffix.lower() not in suffixes:
        raise ConfigError(f"{path}: wanted a name that ends in {' or '.join(suffixes)}.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}.") from error


def _photographer(
    picture: Path | None, environment: Path | None, renderer: str, maps: Mapping[str, float]
) -> Callable[[Subject, Layer], list[Path]]:
    """What writes the picture, if one is wanted, and gives the paths written."""
    if picture is None:
        if environment is not None or renderer != "auto":
            raise click.UsageError("--environment and --renderer go with --picture.")
        return lambda subject, layer: []
    _require_place(picture, ".png", ".jpg", ".jpeg")

    from svbrdfgan.config.choices import PluginChoice
    from svbrdfgan.inference.export import write_picture
    from svbrdfgan.io import load_environment
    from svbrdfgan.plugins.select import resolve_renderer
    from svbrdfgan.procedural import build_sky, sample_sky

    chosen, _ = resolve_renderer(PluginChoice(name=renderer), maps=maps)
    light = build_sky(sample_sky(_SKY)) if environment is None else load_environment(environment)

    def take(subject: Subject, layer: Layer) -> list[Path]:
        write_picture(picture, subject, layer, chosen, light, maps)
        return [picture]

    return take
