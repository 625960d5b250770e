"""What several commands read from their command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from svbrdfgan.config.yaml_files import apply_overrides
from svbrdfgan.errors import ConfigError

if TYPE_CHECKING:
    from svbrdfgan.config.choices import PartSelection
    from svbrdfgan.scene.asset import Subject

learnable_option = click.option(
    "--learnable",
    multiple=True,
    metavar="PATTERN",
    help="Parts that carry the layer, as 'body*'; repeatable.  [default: all but glass, wheels, lights and the like]",
)


def key_values(pairs: tuple[str, ...]) -> dict[str, Any]:
    """Options from KEY=VALUE words, the values as in YAML.

    Raises:
        ConfigError: a word is not of that form.
    """
    return apply_overrides({}, pairs)


def selected(patterns: tuple[str, ...]) -> PartSelection | None:
    """The parts that `--learnable` names; None where it was not given."""
    from svbrdfgan.config.choices import PartSelection

    return PartSelection(include=patterns, exclude=()) if patterns else None


def require_apart(mesh: Path, out: Path) -> None:
    """Refuses to write over the mesh that is read.

    Raises:
        ConfigError: both are one file.
    """
    if out.exists() and mesh.exists() and out.samefile(mesh):
        raise ConfigError(f"{out} is the mesh itself, of which the result keeps little: choose another name.")


def tell_parts(subject: Subject) -> None:
    """Says on stderr which parts carry the layer, since names alone decide that."""
    parts = [(part.name, number in subject.learnable) for number, part in enumerate(subject.surface.parts)]
    carrying, clean = (", ".join(name for name, learnable in parts if learnable is wanted) for wanted in (True, False))
    click.echo(f"layer on: {carrying}; left clean: {clean or 'none'}", err=True)
    for told in subject.overlooked():
        click.echo(f"warning: {told}", err=True)
