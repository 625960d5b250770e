"""The overview picture of a run, for a README or a slide."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from svbrdfgan.evaluation.evaluate import Evaluated, pictures
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.metrics.flip import display
from svbrdfgan.report.pictures import INK, PAPER, Picture, cell, font, framed, over_checker, signed_as_color, upright
from svbrdfgan.report.vehicles import choose_views

if TYPE_CHECKING:
    from PIL.Image import Image

_GAP, _HEAD, _HEIGHT = 12, 40, 234
_COLUMNS = {"geometry": 232, "truth": 350, "learned from pictures": 350, "layer painted": 232}
"""Names and widths of the columns, in pixels."""

WIDTH = sum(_COLUMNS.values()) + _GAP * (len(_COLUMNS) - 1)
_BYTES = 400_000


def write_hero(run: Path, evaluated: Evaluated, path: Path, *, rows: int = 4) -> None:
    """Writes a PNG of 1200 pixels width and under 400 kB: for each of a few vehicles, a row from geometry to layer.

    Raises:
        AssetError: it cannot be written.
    """
    views = choose_views(evaluated.source.exemplars, rows)
    sheet = _sheet([_row(evaluated, index) for index in views])
    with atomic_path(path) as temporary:
        temporary.write_bytes(_small_png(sheet))


def _row(evaluated: Evaluated, index: int) -> tuple[Picture, ...]:
    exemplars, number = evaluated.source.exemplars, int(evaluated.source.exemplars.subject_of[index])
    subject, layer = exemplars.subjects[number], evaluated.layers["generated"][number].cpu().float()
    truth = display(exemplars.images[index].float(), coverage=exemplars.coverage[index].float())
    learned = pictures(evaluated.source, index, {"generated": evaluated.layers["generated"]})["generated"]
    normal = upright(signed_as_color(subject.geometry[3:6].cpu()), subject.buffer.mask)
    coverage = exemplars.coverage[index]
    return (
        normal,
        framed(truth, coverage),
        framed(learned, coverage),
        upright(over_checker(layer), subject.learnable_texels),
    )


def _sheet(rows: list[tuple[Picture, ...]]) -> Image:
    """The rows of pictures beneath the names of the columns."""
    from PIL import Image as PillowImage
    from PIL import ImageDraw

    sheet = PillowImage.new("RGB", (WIDTH, _HEAD + len(rows) * (_HEIGHT + _GAP) - _GAP), PAPER)
    draw, letters, left = ImageDraw.Draw(sheet), font(18), 0
    for column, (title, width) in enumerate(_COLUMNS.items()):
        draw.text((left + width / 2, _HEAD / 2), title, fill=INK, font=letters, anchor="mm")
        for number, row in enumerate(rows):
            sheet.paste(cell(row[column], width, _HEIGHT), (left, _HEAD + number * (_HEIGHT + _GAP)))
        left += width + _GAP
    return sheet


def _small_png(sheet: Image) -> bytes:
    """The picture as PNG: in full colour if that is small enough, else dithered, in as many colours as fit."""
    data = _png(sheet)
    for colors in (256, 128, 64, 32, 16):
        if len(data) <= _BYTES:
            break
        data = _png(sheet.quantize(palette=sheet.quantize(colors)))
    return data


def _png(image: Image) -> bytes:
    stream = BytesIO()
    image.save(stream, format="PNG", optimize=True)
    return stream.getvalue()
