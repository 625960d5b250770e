"""What `weather` and `texture` do with --embedding-uvs: a surface over the UVs of its embedding, and its layer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from svbrdfgan.cli.display import echo, note
from svbrdfgan.cli.options import PartOptions
from svbrdfgan.config.choices import PartSelection
from svbrdfgan.inference.apply import explain_memory, prepare
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.studio import Studio
from svbrdfgan.io.mesh import load_mesh
from svbrdfgan.plugins.registry import load_embedding
from svbrdfgan.report.sheet import Row, write_sheet
from svbrdfgan.scene.embedded_files import write_embedded
from svbrdfgan.scene.subject import Subject, make_subject
from svbrdfgan.types import Layer
from svbrdfgan.utils.display import Display
from svbrdfgan.weathering.layer import weather
from svbrdfgan.weathering.recipes import Recipe


@dataclass(frozen=True)
class Embedded:
    """What is asked for of every surface.

    Attributes:
        display: shows what is being done.
        parts: patterns over the names of parts that carry the layer, or are kept.
        maps: as for `Subject.materials`.
        picture: where a picture of it is written; None if none is wanted.
    """

    display: Display
    parts: PartOptions
    maps: Mapping[str, float | None]
    studio: Studio | None
    picture: Path | None

    def weather(self, mesh: Path, path: Path, recipe: Recipe, embedding: str, resolution: int) -> list[Path]:
        """Writes a mesh under a recipe; returns the paths written."""
        self.display.stage(f"loading {mesh}")
        loaded = load_mesh(mesh)
        self.display.stage(f"unwrapping {mesh}")
        unwrapping, parts = load_embedding(embedding), self._selection or PartSelection()
        subject = make_subject(loaded, unwrapping, resolution, parts, file_maps=bool(self.maps))
        self.display.stage(f"weathering {mesh}")
        layer = weather(subject.surface, subject.buffer, recipe, self.maps)
        _report(subject)
        return self._write(path, subject, layer)

    def texture(
        self,
        mesh: Path,
        paths: Sequence[Path],
        draws: Sequence[LearnedWeathering],
        rows: Sequence[Row],
        sheet: Path | None,
    ) -> Iterator[Path]:
        """Writes a mesh under each of a model's draws, and a sheet if one is wanted; yields the paths written."""
        self.display.stage(f"weathering {mesh}")
        model, resolution = draws[0].model, draws[0].resolution
        with explain_memory(resolution):
            canvas = prepare(load_mesh(mesh), model, self._selection, resolution)
            _report(canvas.subject)
            for path, draw in zip(paths, draws, strict=True):
                yield from self._write(path, canvas.subject, canvas.paint(draw.draw))
            if sheet is not None and self.studio is not None:
                write_sheet(sheet, rows, canvas, self.studio, self.maps, display=self.display)
                yield sheet

    @property
    def _selection(self) -> PartSelection | None:
        """The parts that patterns choose; None if none was given."""
        learnable, keep, default = self.parts.learnable, self.parts.keep, PartSelection()
        if not learnable and not keep:
            return None
        exclude = keep or (() if learnable else default.exclude)
        return PartSelection(include=learnable or default.include, exclude=exclude)

    def _write(self, path: Path, subject: Subject, layer: Layer) -> list[Path]:
        self.display.stage(f"writing {path}")
        written = [path, write_embedded(path, subject, layer, self.maps)]
        if self.picture is not None and self.studio is not None:
            stand = self.studio.stand(subject.surface)
            stand.write(self.picture, subject.materials(layer, self.maps), display=self.display)
            written.append(self.picture)
        return written


def _report(subject: Subject) -> None:
    """Prints on stderr which parts carry the layer, since part names alone decide that."""
    parts = [(part.name, number in subject.learnable) for number, part in enumerate(subject.surface.parts)]
    carrying, clean = (", ".join(name for name, learnable in parts if learnable is wanted) for wanted in (True, False))
    note(f"layer on: {carrying}; left clean: {clean or 'none'}")
    for warning in subject.overlooked():
        echo(f"warning: {warning}", err=True)
