"""A map's measures as a file and as a picture: checkerboard and stretch on the mesh, and the map itself."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from PIL import Image, ImageDraw, ImageFont

from svbrdfgan.geometry.bake import exposed_faces
from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.metrics.uv.distortion import face_stretch, singular_values
from svbrdfgan.metrics.uv.layout import chart_of_faces, crowded_texels
from svbrdfgan.metrics.uv.summary import UVSummary
from svbrdfgan.metrics.uv.visibility import VisibleSurface, visible_surface
from svbrdfgan.report.pictures import font as unicode_font
from svbrdfgan.report.uv_views import Seen, checker, look, paint
from svbrdfgan.types import Surface

_VIEWS = ((math.radians(38.0), math.radians(20.0)), (math.radians(218.0), math.radians(20.0)))
_SIZE = (560, 350)
_ATLAS = 768
_CARD = (1936, 960)
_COLUMNS = (8, 576, 1160)  # pixels from the left; the atlas is in the last one
_ROWS = (36, 480)  # pixels from the top
_CAPTION = 17  # size of captions, pixels
_SMALL = 15  # size of other text, pixels
_OCTAVES = 2.0  # of the scale of stretch, to each side
_COOL_TO_WARM = np.array(
    [[0.23, 0.3, 0.75], [0.55, 0.69, 1.0], [0.87, 0.87, 0.87], [0.96, 0.6, 0.48], [0.71, 0.02, 0.15]]
)
_BORDER = np.array([0.1, 0.1, 0.1])  # sRGB of charts' outlines in the atlas
_FLIPPED = np.array([0.85, 0.1, 0.1])  # of mirrored texels
_CROWDED = np.array([0.1, 0.1, 0.85])  # of texels that hold two places
_LINES = (
    (("L2 stretch", "stretch_l2"), ("L-inf stretch", "stretch_linf"), ("stretch p99", "stretch_p99")),
    (("angles, mean", "angle_mean"), ("angles, p99", "angle_p99"), ("collapsed", "collapsed")),
    (("areas, mean", "area_mean"), ("areas, p99", "area_p99"), ("coverage", "coverage")),
    (("flipped", "flipped"), ("overlapping", "overlapping"), ("connectivity", "connectivity")),
    (("seam length", "seam_length"), ("charts", "charts"), ("outside kept", "kept")),
)


def write_summary(folder: Path, surface: Surface, title: str) -> UVSummary:
    """Measures the surface's map, writes `card.json` and `card.png`, and gives the summary.

    Raises:
        AssetError: the disk refuses.
    """
    card = Image.new("RGB", _CARD, "white")
    with ThreadPoolExecutor(len(_VIEWS)) as threads:
        views = threads.map(lambda angles: look(surface, angles[0], angles[1], *_SIZE), _VIEWS)
        visible = visible_surface(surface)
        measured, atlas = threads.submit(UVSummary.of, visible), threads.submit(atlas_picture, visible)
        _draw_views(card, surface, visible, list(views))
    summary = measured.result()
    _draw_map(card, atlas.result(), summary, title)
    with atomic_path(folder / "card.json") as temporary:
        temporary.write_text(summary_json(summary) + "\n")
    with atomic_path(folder / "card.png") as temporary:
        card.save(temporary, format="PNG", compress_level=4)  # half the default level's time, hardly larger
    return summary


def summary_json(summary: UVSummary) -> str:
    """The summary as a JSON object; a measure that is not finite is null."""
    return json.dumps(
        {name: value if math.isfinite(value) else None for name, value in summary.flat().items()}, indent=2
    )


def _draw_views(card: Image.Image, surface: Surface, visible: VisibleSurface, views: Sequence[Seen]) -> None:
    """The left side: the views with the checkerboard, and below with the stretch and its scale."""
    shown = exposed_faces(surface)
    stretch = _Stretch.of(surface, visible)
    for x, seen in zip(_COLUMNS, views, strict=False):
        for y, color in zip(_ROWS, (lambda seen: checker(seen.uv), stretch.color), strict=True):
            card.paste(_image(paint(seen, shown, color)), (x, y))
    _caption(card, _COLUMNS[0], _ROWS[0], "checkerboard of 32 x 32")
    _caption(card, _COLUMNS[0], _ROWS[1], "stretch: length on the surface per length in UV; 1 is the mean")
    _draw_scale(card)


def _draw_map(card: Image.Image, atlas: Float[ndarray, "rows cols 3"], summary: UVSummary, title: str) -> None:
    """The right side: the atlas, below it the measures in columns, and what its colours mean."""
    left, top = _COLUMNS[2], _ROWS[0] + _ATLAS + 10
    card.paste(_image(atlas[::-1]), (left, _ROWS[0]))
    _caption(card, left, _ROWS[0], f"{title}: the map of what is seen")
    draw, font = ImageDraw.Draw(card), ImageFont.load_default(_SMALL)
    values = summary.flat()
    for row, line in enumerate(_LINES):
        for column, (name, key) in enumerate(line):
            x, y = left + 275 * column, top + 20 * row
            draw.text((x, y), name, "black", font)
            draw.text((x + 200, y), _number(values[key]), "black", font, anchor="ra")
    meaning = "red: mirrored, as seen from outside; blue: holds two places; purple: both"
    draw.text((left, top + 20 * len(_LINES) + 10), meaning, "black", font)


def _caption(card: Image.Image, x: int, y: int, text: str) -> None:
    """A line of text above a picture whose upper left corner is at (x, y)."""
    # Pillow's own font has ASCII only, but the other one costs the import of matplotlib
    font = ImageFont.load_default(_CAPTION) if text.isascii() else unicode_font(_CAPTION)
    ImageDraw.Draw(card).text((x, y - 8), text, "black", font, anchor="ls")


def _image(picture: Float[ndarray, "height width 3"]) -> Image.Image:
    return Image.fromarray((255.0 * picture + 0.5).astype(np.uint8))


def _draw_scale(card: Image.Image) -> None:
    """The bar that explains the colours of stretch, below the views."""
    draw, font = ImageDraw.Draw(card), ImageFont.load_default(_SMALL)
    left, top, width, height = _COLUMNS[0] + 160, _ROWS[1] + _SIZE[1] + 24, 808, 16
    card.paste(_image(np.tile(_cool_to_warm(np.linspace(-1.0, 1.0, width)), (height, 1, 1))), (left, top))
    draw.rectangle((left - 1, top - 1, left + width, top + height), outline="black")
    for at, label in enumerate(("1/4 or less", "1/2", "1", "2", "4 or more")):
        x = left + at * (width - 1) // 4
        draw.line((x, top + height, x, top + height + 5), "black")
        draw.text((x, top + height + 8), label, "black", font, anchor="ma")


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The colours of sqrt((Gamma^2 + gamma^2) / 2), each face's own L2 stretch.

    Attributes:
        octaves: its binary logarithm, per face of the surface.
    """

    octaves: Float[ndarray, " faces"]

    @classmethod
    def of(cls, surface: Surface, visible: VisibleSurface) -> _Stretch:
        """The stretch, normalised as on the summary: by what is seen."""
        largest, least = singular_values(surface.positions[surface.faces], surface.uv[surface.faces])
        scale = 1.0
        if len(visible.faces):
            of_found, own = face_stretch(visible)[0], singular_values(visible.positions[visible.faces], visible.uv)[0]
            good = np.isfinite(own) & (own > 0)
            scale = float(np.median(of_found[good] / own[good])) if good.any() else 1.0
        l2 = scale * np.hypot(largest, least) / math.sqrt(2.0)
        return cls(np.log2(np.clip(np.nan_to_num(l2, posinf=1e9), 1e-9, 1e9)))

    def color(self, seen: Seen) -> Float[ndarray, "height width 3"]:
        return _cool_to_warm(self.octaves / _OCTAVES)[seen.face]


def _cool_to_warm(values: Float[ndarray, " n"]) -> Float[ndarray, "n 3"]:
    """Blue for -1 and less, grey for 0, red for 1 and more."""
    stops = np.linspace(-1.0, 1.0, len(_COOL_TO_WARM))
    return np.stack([np.interp(values, stops, channel) for channel in _COOL_TO_WARM.T], axis=-1)


def atlas_picture(visible: VisibleSurface, texels: int = _ATLAS) -> Float[ndarray, "rows cols 3"]:
    """The map, row 0 at v = 0: the checkerboard, charts outlined, mirrored texels red and crowded ones blue."""
    picture = np.full((texels * texels, 3), 0.93)
    hits, crowded = crowded_texels(visible, texels)
    centre = np.stack([hits.point % texels + 0.5, hits.point // texels + 0.5], axis=1) / texels
    picture[hits.point] = 0.45 + 0.55 * checker(centre)
    for wrong, color in ((visible.uv_areas[hits.triangle] < 0, _FLIPPED), (crowded, _CROWDED)):
        at = hits.point[wrong]
        picture[at] = 0.45 * picture[at] + 0.55 * color
    chart = np.full(texels * texels, -1)
    chart[hits.point] = chart_of_faces(visible)[hits.triangle]
    picture[_borders(chart.reshape(texels, texels)).ravel()] = _BORDER
    return picture.reshape(texels, texels, 3)


def _borders(chart: ndarray) -> Bool[ndarray, "rows cols"]:
    """Texels of a chart with a neighbour that is not of it."""
    border = np.zeros(chart.shape, dtype=bool)
    for axis in (0, 1):
        for step in (1, -1):
            border |= np.roll(chart, step, axis=axis) != chart
    return border & (chart >= 0)


def _number(value: float) -> str:
    return f"{value}" if isinstance(value, int) else f"{value:.4g}"
