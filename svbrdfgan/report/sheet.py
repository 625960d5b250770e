"""A sheet of what a model paints on a mesh: draws side by side, growing amounts, and each recipe, in one light."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from svbrdfgan.errors import ConfigError
from svbrdfgan.inference.apply import Canvas, choose_draw
from svbrdfgan.inference.studio import Studio
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.io.image import srgb_from_linear
from svbrdfgan.networks.draw import Draw
from svbrdfgan.report.pictures import INK, PAPER, cell, font
from svbrdfgan.training.run import Model
from svbrdfgan.utils.display import Display, SilentDisplay

COLUMNS = 6
_CELL = (320, 200)  # width and height of a picture; pixels, as all sizes
_RENDERED = (640, 400)  # the same before it is reduced
_GAP = 8  # between pictures
_LABEL = 28  # height of the text below a picture
_HEAD = 44  # height of a row's title


@dataclass(frozen=True, eq=False)
class Row:
    """Pictures of a sheet.

    Attributes:
        cells: draws, each with its label.
    """

    title: str
    cells: tuple[tuple[str, Draw], ...]


def sheet_rows(
    model: Model, *, seed: int | None = None, amount: float | None = None, recipe: str | None = None
) -> list[Row]:
    """Rows of seeds, amounts and recipes: what the model varies with. Other conditions are those given.

    Args:
        seed, amount, recipe: as for `paint`. Seeds begin with this one.

    Raises:
        ConfigError: the model paints one layer on each mesh, or does not know what is asked for.
    """
    choose_draw(model, seed=seed, amount=amount, recipe=recipe)  # its mistakes are found before anything slow
    rows = list(_rows(model, seed, amount, recipe))
    if not rows:
        raise ConfigError("the model paints one layer on a mesh, so a sheet has nothing to compare: leave it out.")
    return rows


def _rows(model: Model, seed: int | None, amount: float | None, recipe: str | None) -> Iterator[Row]:
    known = model.config.conditions
    several = known.recipes if len(known.recipes) > 1 else ()

    def draw(seed: int | None = seed, amount: float | None = amount, recipe: str | None = recipe) -> Draw:
        return choose_draw(model, seed=seed, amount=amount, recipe=recipe)

    of_recipe = [] if recipe is None or not several else [recipe]
    of_amount = [] if known.amount is None else [f"amount {(draw().labels[0] + 1) / 2:.2f}"]
    of_seed = [f"seed {seed or 0}"] if model.generator.random_fields else []
    if model.generator.random_fields:
        seeds = range(seed or 0, (seed or 0) + COLUMNS)
        cells = tuple((f"seed {number}", draw(seed=number)) for number in seeds)
        yield Row(", ".join(["Seeds", *of_recipe, *of_amount]), cells)
    if known.amount is not None:
        amounts = torch.linspace(*known.amount, COLUMNS).tolist()
        cells = tuple((f"amount {step:.2f}", draw(amount=step)) for step in amounts)
        yield Row(", ".join(["Amounts", *of_recipe, *of_seed]), cells)
    if several:
        cells = tuple((other, draw(recipe=other)) for other in several)
        yield Row(", ".join(["Recipes", *of_amount, *of_seed]), cells)


def write_sheet(
    path: Path,
    rows: Sequence[Row],
    canvas: Canvas,
    studio: Studio,
    maps: Mapping[str, float | None] | None = None,
    *,
    spp: int = 32,
    display: Display | None = None,
) -> None:
    """Renders each draw from the front, all with one exposure.

    Args:
        path: .png or .jpg.
        maps: as for `Subject.materials`.

    Raises:
        AssetError: the file cannot be written.
    """
    from PIL import Image, ImageDraw

    stand, subject = studio.stand(canvas.subject.surface), canvas.subject
    layers = (canvas.paint(draw) for row in rows for _, draw in row.cells)
    pictures = (
        srgb_from_linear(stand.show(subject.materials(layer, maps), size=_RENDERED, spp=spp)) for layer in layers
    )
    shown = display or SilentDisplay()
    shown.stage(f"writing {path}", sum(len(row.cells) for row in rows))
    (width, height), columns = _CELL, max(len(row.cells) for row in rows)
    tall = _HEAD + height + _LABEL
    sheet = Image.new("RGB", (columns * (width + _GAP) + _GAP, len(rows) * tall + _GAP), PAPER)
    ink = ImageDraw.Draw(sheet)
    for number, row in enumerate(rows):
        ink.text((_GAP, number * tall + _HEAD / 2), row.title, fill=INK, font=font(20), anchor="lm")
        for column, (label, _) in enumerate(row.cells):
            left, top = _GAP + column * (width + _GAP), number * tall + _HEAD
            sheet.paste(cell(next(pictures), width, height), (left, top))
            shown.advance()
            ink.text((left + width / 2, top + height + _LABEL / 2), label, fill=INK, font=font(16), anchor="mm")
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="PNG" if path.suffix.lower() == ".png" else "JPEG", quality=92)
