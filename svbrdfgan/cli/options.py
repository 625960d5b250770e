"""Parts that several commands share: options, checks of paths, and the files that `weather` and `texture` write."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.errors import ConfigError

if TYPE_CHECKING:
    from svbrdfgan.config.choices import PartSelection
    from svbrdfgan.inference.export import Studio
    from svbrdfgan.scene.subject import Subject
    from svbrdfgan.types import Layer

Command = TypeVar("Command", bound=Callable[..., None])
_SKY_SEED = 7  # of the cloudy sky that lights pictures by default

learnable_option = click.option(
    "--learnable",
    multiple=True,
    metavar="PATTERN",
    help="Parts that carry the layer, such as 'body*'; repeatable.  "
    "[default: all but glass, wheels, lights and the like]",
)


def picture_options(command: Command) -> Command:
    """Adds `picture`, `environment` and `renderer` to a command's options."""
    path = click.Path(path_type=Path, dir_okay=False)
    for option in (
        click.option("--renderer", default="auto", show_default=True, help="For pictures; see `svbrdfgan backends`."),
        click.option("--environment", type=path, help="For pictures: .hdr or .exr.  [default: a cloudy sky]"),
        click.option("--picture", type=path, help="Also render the mesh from two sides, to a .png or .jpg file."),
    ):
        command = option(command)
    return command


def key_values(words: tuple[str, ...]) -> dict[str, Any]:
    """Options from KEY=VALUE words; values are read as YAML.

    Raises:
        ConfigError: a word is not of that form.
    """
    return apply_overrides({}, words)


def read_config(path: Path, overrides: tuple[str, ...]) -> dict[str, Any]:
    """The contents of a YAML file, with KEY=VALUE words put in.

    Raises:
        ConfigError: the file is not a YAML mapping, or a word is not of that form.
    """
    return apply_overrides(load_yaml(path), overrides)


def selected(patterns: tuple[str, ...]) -> PartSelection | None:
    """The parts that `--learnable` names; None if it was not given."""
    from svbrdfgan.config.choices import PartSelection

    return PartSelection(include=patterns, exclude=()) if patterns else None


def require_apart(mesh: Path, out: Path) -> None:
    """Refuses an output path that is the input mesh.

    Raises:
        ConfigError: both are the same file.
    """
    if out.exists() and mesh.exists() and out.samefile(mesh):
        raise ConfigError(f"{out} is the input mesh, which the output would overwrite; choose another path.")


def studio_maker(
    pictures: Mapping[str, Path | None],
    environment: Path | None,
    renderer: str,
    maps: Mapping[str, float | None],
) -> Callable[[Subject], Studio]:
    """A function that makes the studio in which a subject's pictures are rendered. Paths and renderer are checked now.

    Args:
        pictures: by option, where each picture is written; None if it is not wanted.

    Raises:
        UsageError: no picture is wanted, but an environment or a renderer is named.
        ConfigError: a file cannot be written there.
        PluginError: the renderer does not work, or cannot read the maps.
    """
    wanted = [path for path in pictures.values() if path is not None]
    if not wanted:
        if environment is not None or renderer != "auto":
            raise click.UsageError(f"--environment and --renderer need {' or '.join(pictures)}.")
        return _no_studio
    for path in wanted:
        _require_writable(path, ".png", ".jpg", ".jpeg")

    from svbrdfgan.config.choices import PluginChoice
    from svbrdfgan.inference.export import Studio
    from svbrdfgan.io.environment import load_environment
    from svbrdfgan.plugins.select import resolve_renderer
    from svbrdfgan.procedural.sky import build_sky, sample_sky

    chosen, _ = resolve_renderer(PluginChoice(name=renderer), maps=maps)
    light = build_sky(sample_sky(_SKY_SEED)) if environment is None else load_environment(environment)
    return lambda subject: Studio(subject, chosen, light, maps)


def _no_studio(_: Subject) -> Studio:
    raise AssertionError("no picture was asked for")


def writer(
    out: Path, picture: Path | None, studio: Callable[[Subject], Studio], maps: Mapping[str, float | None]
) -> Callable[[Subject, Layer], list[Path]]:
    """A function that writes a weathered mesh and gives the paths written. Checks the mesh's path beforehand.

    Raises:
        ConfigError: a file cannot be written there.
    """
    _require_writable(out, ".glb")

    def write(subject: Subject, layer: Layer) -> list[Path]:
        from svbrdfgan.inference.export import write_weathered

        written = [out, write_weathered(out, subject, layer, maps)]
        if picture is not None:
            studio(subject).write(picture, layer)
            written.append(picture)
        return written

    return write


def report_weathered(subject: Subject, written: list[Path]) -> None:
    """Prints the paths written; and on stderr which parts carry the layer, since part names alone decide that."""
    parts = [(part.name, number in subject.learnable) for number, part in enumerate(subject.surface.parts)]
    carrying, clean = (", ".join(name for name, learnable in parts if learnable is wanted) for wanted in (True, False))
    click.echo(f"layer on: {carrying}; left clean: {clean or 'none'}", err=True)
    for warning in subject.overlooked():
        click.echo(f"warning: {warning}", err=True)
    click.echo("\n".join(map(str, written)))


def _require_writable(path: Path, *suffixes: str) -> None:
    """Refuses a path without one of the suffixes, and makes its folder."""
    if path.suffix.lower() not in suffixes:
        raise ConfigError(f"{path}: wanted a name that ends in {' or '.join(suffixes)}.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}.") from error
