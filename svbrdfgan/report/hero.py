"""One picture of what a run can do, for a README or a slide."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.report.pictures import Picture, over_checker, signed_as_color, to_pillow, upright
from svbrdfgan.report.vehicles import choose_views
from svbrdfgan.scoring.evaluate import Evaluated, pictures
from svbrdfgan.scoring.flip import display

if TYPE_CHECKING:
    from PIL.Image import Image

WIDTH, _GAP, _HEAD = 1200, 12, 40
_COLUMNS = ("geometry (normals)", "truth", "learned from pictures", "layer painted")
_BYTES = 400_000
_PAPER, _INK = (255, 255, 255), (60, 60, 66)


def write_hero(run: Path, evaluated: Evaluated, path: Path, *, rows: int = 4) -> None:
    """Writes a PNG, 1200 pixels wide and under 400 kB: a row for each of a few vehicles, from geometry to picture.

    Raises:
        AssetError: it cannot be written.
    """
    views = choose_views(evaluated.feed.exemplars, rows)
    cells = [[_cell(picture) for picture in _row(evaluated, index)] for index in views]
    with atomic_path(path) as temporary:
        temporary.write_bytes(_small_png(_sheet(cells)))


def _row(evaluated: Evaluated, index: int) -> tuple[Picture, ...]:
    exemplars, number = evaluated.feed.exemplars, int(evaluated.feed.exemplars.subject_of[index])
    subject, layer = exemplars.subjects[number], evaluated.layers["generated"][number].cpu().float()
    truth = display(exemplars.images[index].float(), coverage=exemplars.coverage[index].float())
    learned = pictures(evaluated.feed, index, {"generated": evaluated.layers["generated"]})["generated"]
    normal = upright(signed_as_color(subject.geometry[3:6].cpu()), subject.buffer.mask)
    return normal, truth, learned, upright(over_checker(layer), subject.learnable_texels)


def _cell(picture: Picture) -> Image:
    """On paper, as wide as a column."""
    from PIL import Image as PillowImage

    image = to_pillow(picture)
    width = (WIDTH - _GAP * (len(_COLUMNS) - 1)) // len(_COLUMNS)
    image = image.resize((width, round(width * image.height / image.width)), PillowImage.Resampling.LANCZOS)
    paper = PillowImage.new("RGB", image.size, (236, 236, 238))
    paper.paste(image, mask=image.getchannel("A") if image.mode == "RGBA" else None)
    return paper


def _sheet(rows: list[list[Image]]) -> Image:
    """The cells in a grid beneath the names of the columns."""
    from PIL import Image as PillowImage
    from PIL import ImageDraw

    heights = [max(cell.height for cell in row) for row in rows]
    sheet = PillowImage.new("RGB", (WIDTH, _HEAD + sum(heights) + _GAP * max(len(rows) - 1, 0)), _PAPER)
    draw, font, top = ImageDraw.Draw(sheet), _font(), _HEAD
    step = (WIDTH + _GAP) // len(_COLUMNS)
    for column, title in enumerate(_COLUMNS):
        draw.text((column * step, _HEAD / 2), title, fill=_INK, font=font, anchor="lm")
    for row, height in zip(rows, heights, strict=True):
        for column, cell in enumerate(row):
            sheet.paste(cell, (column * step, top + (height - cell.height) // 2))
        top += height + _GAP
    return sheet


def _font() -> object:
    """The sans-serif that matplotlib ships: Pillow's own is not always scalable."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), 18)


def _small_png(sheet: Image) -> bytes:
    """The picture as PNG: in full colour if that is small enough, else in the most colours that are."""
    data = _png(sheet)
    for colors in (256, 128, 64, 32, 16):
        if len(data) <= _BYTES:
            break
        data = _png(sheet.quantize(colors))
    return data


def _png(image: Image) -> bytes:
    stream = BytesIO()
    image.save(stream, format="PNG", optimize=True)
    return stream.getvalue()
