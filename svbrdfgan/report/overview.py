"""The overview picture of a run, for a README or a slide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from svbrdfgan.evaluation.evaluated import Evaluated, pictures
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.metrics.flip import display
from svbrdfgan.report.pictures import INK, PAPER, Picture, cell, font, framed, over_checker, signed_as_color, upright
from svbrdfgan.report.vehicles import choose_views

if TYPE_CHECKING:
    from PIL.Image import Image

WIDTH = 1200
_GAP = 12  # between pictures, pixels
_HEAD = 40  # height of the titles, pixels
_BYTES = 400_000  # of the file, at most
_TITLES = ("geometry", "truth", "learned from pictures", "layer painted")
_WIDTHS = (232, 350, 350, 232)  # of the columns, pixels
_HEIGHT = 234  # of a row, pixels
_WIDTHS_OF_FIVE = (180, 270, 270, 180, 252)  # with a further column, which comes last
_HEIGHT_OF_FIVE = 180


@dataclass(frozen=True, eq=False)
class FurtherColumn:
    """A column of pictures in addition to those that every run has.

    Attributes:
        picture: of an exemplar of the evaluated split, by its index.
    """

    title: str
    picture: Callable[[int], Picture]


def write_overview(
    run: Path, evaluated: Evaluated, path: Path, *, rows: int = 4, further: FurtherColumn | None = None
) -> None:
    """Writes a PNG of 1200 pixels width and under 400 kB: for each of a few vehicles, a row from geometry to layer.

    Args:
        further: one more column.

    Raises:
        AssetError: the file cannot be written.
    """
    sheet_rows = []
    for index in choose_views(evaluated.source.exemplars, rows):
        more = (further.picture(index),) if further else ()
        sheet_rows.append((*_row(evaluated, index), *more))
    sheet = _sheet(sheet_rows, (*_TITLES, further.title) if further else _TITLES)
    with atomic_path(path) as temporary:
        temporary.write_bytes(_small_png(sheet))


def _row(evaluated: Evaluated, index: int) -> tuple[Picture, ...]:
    exemplars = evaluated.source.exemplars
    subject, layer = exemplars.subject(index), evaluated.learned(index)
    truth = display(exemplars.images[index].float(), coverage=exemplars.coverage[index].float())
    (learned,) = pictures(evaluated.source, index, [layer])
    normal = upright(signed_as_color(subject.geometry[3:6].cpu()), subject.buffer.mask)
    coverage = exemplars.coverage[index]
    return (
        normal,
        framed(truth, coverage),
        framed(learned, coverage),
        upright(over_checker(layer), subject.learnable_texels),
    )


def _sheet(rows: list[tuple[Picture, ...]], titles: tuple[str, ...]) -> Image:
    """The rows of pictures beneath the names of the columns."""
    from PIL import Image as PillowImage
    from PIL import ImageDraw

    more = len(titles) > len(_TITLES)
    widths, row_height = (_WIDTHS_OF_FIVE, _HEIGHT_OF_FIVE) if more else (_WIDTHS, _HEIGHT)
    sheet = PillowImage.new("RGB", (WIDTH, _HEAD + len(rows) * (row_height + _GAP) - _GAP), PAPER)
    draw, letters, left = ImageDraw.Draw(sheet), font(18), 0
    for column, (title, width) in enumerate(zip(titles, widths, strict=True)):
        draw.text((left + width / 2, _HEAD / 2), title, fill=INK, font=letters, anchor="mm")
        for number, row in enumerate(rows):
            sheet.paste(cell(row[column], width, row_height), (left, _HEAD + number * (row_height + _GAP)))
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
