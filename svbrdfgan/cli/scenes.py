"""What `weather` and `texture` do to a mesh file: its whole scene is written again, weathered."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

from svbrdfgan.asset.asset import load_asset
from svbrdfgan.asset.memory import Plan, require_plan
from svbrdfgan.asset.weather_document import Edited, Textures
from svbrdfgan.cli.display import echo, note
from svbrdfgan.cli.options import PartOptions
from svbrdfgan.inference.file_scene import file_scene
from svbrdfgan.inference.studio import Studio
from svbrdfgan.inference.weathered_file import overlaid_document, weathered_document, write_layer, write_maps
from svbrdfgan.inference.weatherings import Weathering
from svbrdfgan.inference.workpiece import Workpiece, above_ground, open_workpiece, turned
from svbrdfgan.io.gltf.document import write_document
from svbrdfgan.utils.display import Display
from svbrdfgan.utils.memory import gigabytes
from svbrdfgan.weathering.substances import Substance


@dataclass(frozen=True)
class Scenes:
    """What is asked for of every scene.

    Attributes:
        display: shows what is being done.
        textures: how large.
        maps_folder: gets the weathered textures, too; None if they are not wanted.
        variants: whether clean materials are kept, too.
        overlay: gets the layer, which the scene then does not have; None if the scene is weathered.
        parts: where it weathers.
    """

    display: Display
    textures: Textures
    maps_folder: Path | None
    variants: bool
    overlay: Path | None
    parts: PartOptions

    def open(self, mesh: Path, settles_on: Mapping[Substance, float] = MappingProxyType({})) -> Workpiece:
        """The workpiece in a file, on which such matter is to lie. Which parts weather is printed on stderr."""
        self.display.stage(f"loading {mesh}")
        workpiece = open_workpiece(mesh, **asdict(self.parts)).settled(settles_on)
        _report(workpiece)
        return workpiece

    def write(
        self,
        workpiece: Workpiece,
        weathering: Weathering,
        path: Path,
        studio: Studio | None = None,
        picture: Path | None = None,
    ) -> list[Path]:
        """Writes the weathered scene, and a picture of it if one is wanted; returns the paths written.

        What else was done to the scene is printed on stderr.
        """
        if self.overlay is not None:
            return self._write_overlay(workpiece, weathering, path, self.overlay)
        plan = Plan.of(workpiece.asset, workpiece.weathered, self.textures)
        self._require(plan, weathering)
        self.display.stage(f"weathering {workpiece.asset.path}")
        edited = weathered_document(workpiece, weathering, self.textures, variants=self.variants, display=self.display)
        written = self._write(path, edited)
        if self.maps_folder is not None:
            written += write_maps(self.maps_folder, edited)
        if studio is not None and picture is not None:
            self._draw(workpiece, path, studio, picture)
            written.append(picture)
        return written

    def _write_overlay(self, workpiece: Workpiece, weathering: Weathering, path: Path, folder: Path) -> list[Path]:
        """Writes the scene with a further UV set, and the layer over it into a folder; returns the paths written."""
        self._require(Plan.of(workpiece.asset, workpiece.weathered, self.textures).as_overlay(), weathering)
        self.display.stage(f"weathering {workpiece.asset.path}")
        overlay = overlaid_document(workpiece, weathering, self.textures, display=self.display)
        return self._write(path, overlay.edited) + write_layer(folder, overlay)

    def _require(self, plan: Plan, weathering: Weathering) -> None:
        needed = require_plan(plan, weathering.peak_bytes)
        note(f"takes at most about {gigabytes(needed)} of memory")

    def _write(self, path: Path, edited: Edited) -> list[Path]:
        self.display.stage(f"writing {path}")
        written = write_document(path, edited.document)
        for sentence in dict.fromkeys(edited.told):  # one for each node may be the same
            note(sentence)
        return written

    def _draw(self, workpiece: Workpiece, path: Path, studio: Studio, picture: Path) -> None:
        """Renders a written scene as any other program would."""
        self.display.stage(f"rendering {picture}")
        shown = above_ground(load_asset(path), workpiece.verdicts)
        surface, materials = file_scene(turned(shown.mesh, workpiece.orientation))
        studio.stand(surface).write(picture, materials, display=self.display)


def _report(workpiece: Workpiece) -> None:
    parts: dict[bool, dict[str, str]] = {wanted: {} for wanted in (True, False)}  # names in their order
    for verdict in workpiece.verdicts:
        parts[verdict.weathers].setdefault(workpiece.asset.pieces[verdict.piece].part.name, verdict.name)
    ambiguous = parts[True].keys() & parts[False].keys()
    names = {
        wanted: [whole if short in ambiguous else short for short, whole in found.items()]
        for wanted, found in parts.items()
    }
    weathering, kept = (", ".join(names[wanted]) or "nothing" for wanted in (True, False))
    note(f"weathers: {weathering}; kept: {kept}")
    note(str(workpiece.orientation))
    for warning in workpiece.warnings:
        echo(f"warning: {warning}", err=True)
