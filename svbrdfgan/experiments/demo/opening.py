"""The picture that the demo opens with: one vehicle under several weatherings, in a studio, side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from svbrdfgan.asset.weather_document import Textures
from svbrdfgan.inference.denoising import can_denoise
from svbrdfgan.inference.file_scene import file_scene
from svbrdfgan.inference.learned import LearnedWeathering
from svbrdfgan.inference.studio import Studio
from svbrdfgan.inference.weathered_file import weathered_document
from svbrdfgan.inference.weatherings import RecipeWeathering, Weathering
from svbrdfgan.inference.workpiece import Workpiece, open_workpiece, turned
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.gltf.pieces import document_pieces
from svbrdfgan.io.image import srgb_from_linear
from svbrdfgan.io.mesh import join_pieces
from svbrdfgan.models.shipped import shipped_models
from svbrdfgan.report.pictures import INK, PAPER, font, to_pillow
from svbrdfgan.training.run import load_model
from svbrdfgan.types import Materials, Surface
from svbrdfgan.weathering.layer import recipe_from_options

WIDTH = 1600
"""Of the picture, in pixels, as all sizes."""
_ASPECT = 1.9  # width of a cell by its height
_GAP = 5  # between cells
_LABEL = 16  # size of the letters, and their distance from the cell's corner
_PAINTED = 448  # texels along a side of a texture over the whole vehicle: as fine as a cell shows them
_SPP = (48, 8)  # without and with a denoiser
_AMOUNTS = {"rust": (0.5, 0.75, 1.0), "road-dirt": (0.25, 0.5, 0.75)}
_SEEDS = (0, 1)


@dataclass(frozen=True)
class Cell:
    """A weathering to be shown, and the words above its picture."""

    label: str
    weathering: Weathering


def demo_rows() -> list[list[Cell]]:
    """What the demo shows: rust and road dirt, two seeds of each, three amounts; as shipped models learned them."""
    shown = ((name, seed, amounts) for name, amounts in _AMOUNTS.items() for seed in _SEEDS)
    return [[_cell(name, seed, amount) for amount in amounts] for name, seed, amounts in shown]


def _cell(name: str, seed: int, amount: float) -> Cell:
    """What a shipped model learned from the recipe of that name, or the recipe itself where none did."""
    said = f"{name}, seed {seed}, amount {amount:g}"
    if name not in shipped_models():
        return Cell(said, RecipeWeathering(recipe_from_options(name, {"seed": seed, "amount": amount})))
    return Cell(f"learned {said}", LearnedWeathering.of(load_model(name), name=name, seed=seed, amount=amount))


def write_opening(path: Path, vehicle: Path, rows: Sequence[Sequence[Cell]], studio: Studio) -> Iterator[None]:
    """Writes the picture of a vehicle under each weathering; yields after each, for progress.

    Args:
        path: .png or .jpg.
        vehicle: a mesh file.
        rows: of equal length.

    Raises:
        AssetError: a file cannot be read or written.
    """
    from PIL import Image, ImageDraw

    opened, stand = open_workpiece(vehicle), None
    settled = cache(lambda settles_on: opened.settled(dict(settles_on)))  # which keeps what recipes survey
    width = (WIDTH + _GAP) // len(rows[0]) - _GAP
    height = round(width / _ASPECT)
    sheet = Image.new("RGB", (WIDTH, len(rows) * (height + _GAP) - _GAP), PAPER)
    ink, letters = ImageDraw.Draw(sheet), font(_LABEL)
    for top, row in zip(range(0, sheet.height, height + _GAP), rows, strict=True):
        for left, cell in zip(range(0, WIDTH, width + _GAP), row, strict=False):
            surface, materials = _weathered(settled(tuple(cell.weathering.settles_on.items())), cell.weathering)
            stand = studio.stand(surface) if stand is None else stand.sharing_shadow(surface)
            shown = stand.show(materials, size=(width, height), spp=_SPP[can_denoise()])
            sheet.paste(to_pillow(srgb_from_linear(shown), least=1), (left, top))
            ink.text((left + _LABEL, top + _LABEL), cell.label, fill=INK, font=letters)
            yield
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="PNG" if path.suffix.lower() == ".png" else "JPEG", quality=92)


def _weathered(workpiece: Workpiece, weathering: Weathering) -> tuple[Surface, Materials]:
    """The weathered file, without writing it."""
    document = weathered_document(workpiece, weathering, Textures(painted=_PAINTED)).document
    mesh = join_pieces(workpiece.asset.path, document_pieces(document)).mesh
    return file_scene(turned(mesh, workpiece.orientation))
