"""Contact strips, one for each run: held-out vehicles and their layers next to the truth. Sheets stack the strips."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from svbrdfgan.evaluation.evaluated import Evaluated, pictures
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.metrics.flip import display
from svbrdfgan.report.pictures import INK, PAPER, Picture, cell, font, framed, over_checker, upright
from svbrdfgan.report.vehicles import choose_views

if TYPE_CHECKING:
    from PIL.Image import Image

CONTACT_STRIP = "strip.png"
_WIDTHS = {"truth": 240, "learned": 240, "true layer": 160, "learned layer": 160}
_HEIGHT = 160  # of a picture, as all sizes in pixels
_GAP = 8  # between pictures
_LABEL = 280  # width of the strips' names on a sheet
_HEAD = 32  # height of the pictures' titles on a sheet
_VEHICLES = 2  # in a strip
_STRIP = _VEHICLES * (sum(_WIDTHS.values()) + len(_WIDTHS) * _GAP) - _GAP


def write_contact_strip(path: Path, evaluated: Evaluated) -> None:
    """Writes a PNG of two vehicles of the split: the true picture, learned picture, true and learned layer of each.

    Raises:
        AssetError: the file cannot be written.
    """
    from PIL import Image

    strip, left = Image.new("RGB", (_STRIP, _HEIGHT), PAPER), 0
    for index in choose_views(evaluated.source.exemplars, _VEHICLES):
        for picture, width in zip(_pictures(evaluated, index), _WIDTHS.values(), strict=True):
            strip.paste(cell(picture, width, _HEIGHT), (left, 0))
            left += width + _GAP
    _save(path, strip)


def write_contact_sheet(path: Path, strips: Mapping[str, Path]) -> None:
    """Writes a PNG of the strips, one beneath the other, each to the right of its label.

    Raises:
        AssetError: the file cannot be written.
    """
    from PIL import Image, ImageDraw

    letters = font(15)
    sheet = Image.new("RGB", (_LABEL + _STRIP, _HEAD + len(strips) * (_HEIGHT + _GAP)), PAPER)
    draw, left = ImageDraw.Draw(sheet), _LABEL
    for title, width in list(_WIDTHS.items()) * _VEHICLES:
        draw.text((left + width / 2, _HEAD / 2), title, fill=INK, font=letters, anchor="mm")
        left += width + _GAP
    for number, (label, strip) in enumerate(strips.items()):
        top = _HEAD + number * (_HEIGHT + _GAP)
        draw.text((4, top + _HEIGHT / 2), label, fill=INK, font=letters, anchor="lm")
        with Image.open(strip) as image:
            sheet.paste(image, (_LABEL, top))
    _save(path, sheet)


def _pictures(evaluated: Evaluated, index: int) -> tuple[Picture, ...]:
    exemplars, layer = evaluated.source.exemplars, evaluated.learned(index)
    subject, truth = exemplars.subject(index), exemplars.layers[index]
    assert truth is not None
    coverage = exemplars.coverage[index].float()
    (made,) = pictures(evaluated.source, index, [layer])
    return (
        framed(display(exemplars.images[index].float(), coverage=coverage), coverage),
        framed(made, coverage),
        upright(over_checker(truth), subject.learnable_texels),
        upright(over_checker(layer), subject.learnable_texels),
    )


def _save(path: Path, image: Image) -> None:
    with atomic_path(path) as temporary:
        image.save(temporary, format="PNG", optimize=True)
