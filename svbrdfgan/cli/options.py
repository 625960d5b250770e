"""Parts that several commands share: options, checks of paths, and the files that `weather` and `texture` write."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from click.shell_completion import CompletionItem

from svbrdfgan.config.yaml_files import apply_overrides, load_yaml
from svbrdfgan.errors import ConfigError, PluginError
from svbrdfgan.utils.devices import DEVICES
from svbrdfgan.utils.memory import limited
from svbrdfgan.utils.printable import printable

if TYPE_CHECKING:
    from svbrdfgan.inference.studio import Studio

Command = TypeVar("Command", bound=Callable[..., None])

DENSITY = 1024
"""Layers are at least as fine as a texture of that many texels along a side over the whole model, by default."""


_REFERENCE = "numpy"
"""The renderer that is always there, and too slow for pictures of this size."""


def completed(
    names: Callable[[], Iterable[str]], paths: str | None = None
) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """What a shell offers for a parameter: names, and paths if it takes those, too ("file" or "dir")."""

    def complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        found = [CompletionItem(name) for name in names() if name.startswith(incomplete) and printable(name) == name]
        return [*found, CompletionItem(incomplete, type=paths)] if paths else found

    return complete


def known_models() -> Iterable[str]:
    """The names of all shipped models."""
    from svbrdfgan.models.shipped import shipped_models

    return shipped_models()


@dataclass(frozen=True)
class PartOptions:
    """What decides where a mesh weathers; see `open_workpiece`."""

    learnable: tuple[str, ...]
    keep: tuple[str, ...]
    masks: tuple[str, ...]
    front: str | None
    up: str | None
    length: float | None


def part_options(command: Command) -> Command:
    """Adds what decides where a mesh weathers, as the parameter `parts`."""

    @wraps(command)
    def gathered(**values: Any) -> None:
        parts = PartOptions(**{each.name: values.pop(each.name) for each in fields(PartOptions)})
        command(parts=parts, **values)

    for option in (
        click.option(
            "--length",
            type=click.FloatRange(0, min_open=True),
            metavar="METRES",
            help="Length of the model, by which patterns are sized.  [default: the file's, if 2 to 20; else 4.5]",
        ),
        click.option("--up", metavar="AXIS", help="Where the roof is, such as +Z.  [default: found]"),
        click.option("--front", metavar="AXIS", help="Where the nose is, such as +X.  [default: found]"),
        click.option(
            "--mask",
            "masks",
            multiple=True,
            metavar="[MATERIAL=]MASK",
            help="Where the layer may lie: a grey picture over the UVs (black is kept), or a vertex attribute such as "
            "_NAME or COLOR_1; on all materials or those of such a name; repeatable.",
        ),
        click.option("--keep", multiple=True, metavar="PATTERN", help="Parts that are kept as they are; repeatable."),
        click.option(
            "--learnable", multiple=True, metavar="PATTERN", help="Parts that weather, whatever they are; repeatable."
        ),
    ):
        gathered = option(gathered)
    return gathered  # type: ignore[return-value]


def memory_option(command: Command) -> Command:
    """Adds `--memory`, which limits what `require_memory` allows while the command runs; no parameter."""

    def limit(context: click.Context, _option: click.Parameter, given: float | None) -> None:
        context.with_resource(limited(None if given is None else round(given * 2**30)))

    return click.option(
        "--memory",
        type=click.FloatRange(min=0, min_open=True),
        callback=limit,
        expose_value=False,
        metavar="GIB",
        help="Memory that may be taken; what needs more is refused.  [default: 80 % of what is free]",
    )(command)


def delivery_options(command: Command) -> Command:
    """Adds what decides which files are written.

    Parameters are `size`, `maps_folder`, `variants`, `overlay`, `force` and `embedding_uvs`; `memory_option` is added.
    """
    folder = click.Path(path_type=Path, file_okay=False)
    for option in (
        click.option(
            "--embedding-uvs",
            is_flag=True,
            help="For research: write the surface over the UVs of the embedding and the layer beside it, and nothing "
            "else of the scene.",
        ),
        memory_option,
        click.option("--force", is_flag=True, help="Overwrite an earlier result."),
        click.option(
            "--overlay",
            type=folder,
            help="Keep all materials: write one layer into this folder, over a further UV set of what weathers.",
        ),
        click.option(
            "--variants", is_flag=True, help="Keep the clean materials, too: both are listed as glTF's variants."
        ),
        click.option("--maps", "maps_folder", type=folder, help="Also write the weathered textures into this folder."),
        click.option(
            "--size",
            type=click.IntRange(16, 8192),
            help="Texels along the longer side of weathered textures.  [default: as they are; new ones 2048]",
        ),
    ):
        command = option(command)
    return command


def check_delivery(meshes: tuple[Path, ...], parts: PartOptions, given: Mapping[str, Any]) -> None:
    """Refuses options that have no meaning together.

    Args:
        given: the values of a command's parameters, by name.

    Raises:
        UsageError: two of the options exclude each other, or one of them is of one mesh and there are several.
    """
    of_one = ("picture", "sheet", "overlay")
    for name in of_one:
        if given.get(name) and len(meshes) > 1:
            raise click.UsageError(f"--{name} is of one MESH.")
    options = {**given, "mask": parts.masks, "front": parts.front, "up": parts.up, "maps": given["maps_folder"]}
    exclusive = [("overlay", other) for other in ("maps", "variants", "picture", "sheet", "count")]
    scene = ("overlay", "maps", "variants", "mask", "front", "up", "size")
    for pair in [*exclusive, *((option, "embedding_uvs") for option in scene)]:
        if all(options.get(option) for option in pair):
            raise click.UsageError(f"--{pair[0]} and --{pair[1].replace('_', '-')} exclude each other.")


def picture_options(command: Command) -> Command:
    """Adds `picture`, `environment` and `renderer` to a command's options."""
    path = click.Path(path_type=Path, dir_okay=False)
    for option in (
        click.option("--renderer", default="auto", show_default=True, help="For pictures; see `svbrdfgan backends`."),
        click.option("--environment", type=path, help="For pictures: .hdr or .exr.  [default: a studio's soft boxes]"),
        click.option("--picture", type=path, help="Also render the mesh, to a .png or .jpg file."),
    ):
        command = option(command)
    return command


def json_option(what: str) -> Callable[[Command], Command]:
    """Adds `as_json`, which asks for one JSON document on stdout and nothing else there."""
    return click.option("--json", "as_json", is_flag=True, help=f"Print {what} instead.")


def device_option(command: Command) -> Command:
    """Adds `device`: where torch computes."""
    text = "Where to compute; auto is a GPU if there is one."
    return click.option("--device", default="auto", show_default=True, type=click.Choice(DEVICES), help=text)(command)


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


def studio_of(
    pictures: Mapping[str, Path | None], environment: Path | None, renderer: str, maps: Mapping[str, float | None]
) -> Studio | None:
    """The studio in which pictures are rendered; None if none is wanted. Paths and renderer are checked.

    Args:
        pictures: by option, where each picture is written; None if it is not wanted.

    Raises:
        UsageError: no picture is wanted, but an environment or a renderer is named.
        ConfigError: a file cannot be written there.
        PluginError: the renderer does not work, or cannot read the maps, or none is fast.
        AssetError: the environment cannot be read, or is black.
    """
    wanted = [path for path in pictures.values() if path is not None]
    if not wanted:
        if environment is not None or renderer != "auto":
            raise click.UsageError(f"--environment and --renderer need {' or '.join(pictures)}.")
        return None
    for path in wanted:
        require_writable(path, ".png", ".jpg", ".jpeg")

    from svbrdfgan.config.choices import PluginChoice
    from svbrdfgan.inference.studio import BOUNCES, Studio
    from svbrdfgan.io.environment import load_environment
    from svbrdfgan.plugins.select import resolve_renderer
    from svbrdfgan.procedural.softboxes import build_studio

    chosen, named = resolve_renderer(PluginChoice(name=renderer), maps=maps, bounces=BOUNCES)
    if renderer == "auto" and named.name == _REFERENCE:
        raise PluginError(
            "pictures need a fast renderer, which `pip install 'svbrdfgan[mitsuba]'` brings; "
            f"--renderer {_REFERENCE} takes the slow reference."
        )
    light = build_studio() if environment is None else load_environment(environment)
    return Studio(chosen, light)


def require_writable(path: Path, *suffixes: str) -> None:
    """Refuses a path without one of the suffixes, makes its folder, and refuses one in which nothing can be written.

    Raises:
        ConfigError: the path is one of these.
    """
    if path.suffix.lower() not in suffixes:
        raise ConfigError(f"{path}: wanted a name that ends in {' or '.join(suffixes)}.")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{path} cannot be written: {error.strerror}.") from error
    if path.is_dir():
        raise ConfigError(f"{path} is a folder; wanted the name of a file.")
    if not os.access(path.parent, os.W_OK):
        raise ConfigError(f"{path} cannot be written: {path.parent} may not be written to.")
