"""What `weather` and `texture` do with --embedding-uvs: a surface over the UVs of its embedding, and its layer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from svbrdfgan.cli.options import PartOptions
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.inference.embedded import write_embedded
from svbrdfgan.inference.studio import Studio
from svbrdfgan.scene.subject import Subject
from svbrdfgan.types import Layer


def selection(parts: PartOptions) -> PartSelection | None:
    """The parts that patterns over their names choose; None if no pattern was given.

    Raises:
        UsageError: a mask was given.
    """
    if parts.masks:
        raise click.UsageError("--mask and --embedding-uvs exclude each other.")
    learnable, keep = parts.learnable, parts.keep
    if not learnable and not keep:
        return None
    default = PartSelection()
    return PartSelection(include=learnable or default.include, exclude=keep or (() if learnable else default.exclude))


def write_embedded_files(
    path: Path,
    subject: Subject,
    layer: Layer,
    maps: Mapping[str, float | None],
    studio: Studio | None = None,
    picture: Path | None = None,
) -> list[Path]:
    """Writes a weathered surface, its layer, and a picture if one is wanted; returns the paths written."""
    written = [path, write_embedded(path, subject, layer, maps)]
    if picture is not None and studio is not None:
        studio.stand(subject.surface).write(picture, subject.materials(layer, maps))
        written.append(picture)
    return written


def report_embedded(subject: Subject) -> None:
    """Prints on stderr which parts carry the layer, since part names alone decide that."""
    parts = [(part.name, number in subject.learnable) for number, part in enumerate(subject.surface.parts)]
    carrying, clean = (", ".join(name for name, learnable in parts if learnable is wanted) for wanted in (True, False))
    click.echo(f"layer on: {carrying}; left clean: {clean or 'none'}", err=True)
    for warning in subject.overlooked():
        click.echo(f"warning: {warning}", err=True)
