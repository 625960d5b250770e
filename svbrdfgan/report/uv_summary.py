"""A map's measures as a file and as a picture: checkerboard and stretch on the mesh, and the map itself."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.io.atomic import atomic_path
from svbrdfgan.metrics.uv import UVSummary, VisibleSurface, face_stretch, visible_surface
from svbrdfgan.metrics.uv.distortion import singular_values
from svbrdfgan.metrics.uv.layout import chart_of_faces, crowded_texels
from svbrdfgan.report.uv_views import Seen, checker, look, paint
from svbrdfgan.types import Surface

_VIEWS = ((math.radians(38.0), math.radians(20.0)), (math.radians(218.0), math.radians(20.0)))
_SIZE = (560, 350)
_ATLAS = 768
_OCTAVES = 2.0  # of the scale of stretch, to each side
_BORDER, _FLIPPED, _CROWDED = np.array([0.1, 0.1, 0.1]), np.array([0.85, 0.1, 0.1]), np.array([0.1, 0.1, 0.85])
_LINES = (
    (("L2 stretch", "stretch_l2"), ("L∞ stretch", "stretch_linf"), ("stretch p99", "stretch_p99")),
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
    with ThreadPoolExecutor(len(_VIEWS)) as threads:
        views = threads.map(lambda angles: look(surface, angles[0], angles[1], *_SIZE), _VIEWS)
        visible = visible_surface(surface)
        summary = UVSummary.of(visible)
    with atomic_path(folder / "card.json") as temporary:
        temporary.write_text(summary_json(summary) + "\n")
    with atomic_path(folder / "card.png") as temporary:
        _figure(surface, visible, list(views), summary, title).savefig(temporary, format="png", dpi=100)
    return summary


def summary_json(summary: UVSummary) -> str:
    """The summary as a JSON object; a measure that is not finite is null."""
    return json.dumps(
        {name: value if math.isfinite(value) else None for name, value in summary.flat().items()}, indent=2
    )


def _figure(surface: Surface, visible: VisibleSurface, views: Sequence[Seen], summary: UVSummary, title: str) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(18.0, 8.9), layout="constrained")
    halves: Any = figure.subfigures(1, 2, width_ratios=(11.5, 7.5))
    left, right = halves
    hidden = np.array([part.hidden for part in surface.parts])[surface.face_part]
    rows = left.subplots(2, 2)
    for axes, seen in zip(rows[0], views, strict=True):
        _show(axes, paint(seen, ~hidden, lambda seen: checker(seen.uv)))
    stretch = _Stretch.of(surface, visible)
    for axes, seen in zip(rows[1], views, strict=True):
        _show(axes, paint(seen, ~hidden, stretch.color))
    rows[0, 0].set_title("checkerboard of 32 x 32", loc="left", fontsize=13)
    rows[1, 0].set_title("stretch: length on the surface per length in UV; 1 is the mean", loc="left", fontsize=13)
    stretch.scale(left, rows[1])
    atlas = right.subplots()
    _show(atlas, atlas_picture(visible), origin="lower", extent=(0, 1, 0, 1))
    atlas.set_title(f"{title}: the map of what is seen", loc="left", fontsize=13)
    atlas.set_xlabel(_text(summary), family="monospace", fontsize=10.5, loc="left", labelpad=10)
    return figure


def _show(axes: Any, picture: Float[ndarray, "height width 3"], **options: Any) -> None:
    axes.imshow(picture, interpolation="nearest", **options)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """The colours of sqrt((Gamma^2 + gamma^2) / 2), each face's own L2 stretch.

    Attributes:
        octaves: its binary logarithm, per face of the surface.
    """

    octaves: Float[ndarray, " faces"]

    @classmethod
    def of(cls, surface: Surface, visible: VisibleSurface) -> _Stretch:
        """Normalised as on the summary: by what is seen."""
        largest, least = singular_values(surface.positions[surface.faces], surface.uv[surface.faces])
        scale = 1.0
        if len(visible.faces):
            of_found, own = face_stretch(visible)[0], singular_values(visible.positions[visible.faces], visible.uv)[0]
            good = np.isfinite(own) & (own > 0)
            scale = float(np.median(of_found[good] / own[good])) if good.any() else 1.0
        l2 = scale * np.hypot(largest, least) / math.sqrt(2.0)
        return cls(np.log2(np.clip(np.nan_to_num(l2, posinf=1e9), 1e-9, 1e9)))

    def color(self, seen: Seen) -> Float[ndarray, "height width 3"]:
        import matplotlib

        shade = 0.5 + 0.5 * np.clip(self.octaves / _OCTAVES, -1.0, 1.0)
        return np.asarray(matplotlib.colormaps["coolwarm"](shade[seen.face])[..., :3])

    @staticmethod
    def scale(figure: Any, axes: Any) -> None:
        """The bar that explains the colours."""
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize

        bar = figure.colorbar(
            ScalarMappable(Normalize(-_OCTAVES, _OCTAVES), "coolwarm"),
            ax=axes,
            location="bottom",
            aspect=50,
            shrink=0.8,
        )
        bar.set_ticks([-2, -1, 0, 1, 2], labels=["1/4 or less", "1/2", "1", "2", "4 or more"])


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
    """Texels of a chart beside one that is not of it."""
    border = np.zeros(chart.shape, dtype=bool)
    for axis in (0, 1):
        for step in (1, -1):
            border |= np.roll(chart, step, axis=axis) != chart
    return border & (chart >= 0)


def _text(summary: UVSummary) -> str:
    """The measures in columns, and what the colours of the map mean."""
    values = summary.flat()
    lines = ["     ".join(f"{name:<13}{_number(values[key]):>8}" for name, key in line) for line in _LINES]
    return "\n".join([*lines, "", "red: mirrored, as seen from outside; blue: holds two places; purple: both"])


def _number(value: float) -> str:
    return f"{value}" if isinstance(value, int) else f"{value:.4g}"
