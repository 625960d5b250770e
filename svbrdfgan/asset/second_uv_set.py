"""A second UV set for a material whose own UVs cannot hold a layer: each texel shows one place."""

from __future__ import annotations

import logging

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.box_charts import box_charts
from svbrdfgan.asset.charts import cut, new_charts, own_charts
from svbrdfgan.asset.islands import areas, signed_areas, welded
from svbrdfgan.asset.packing import ChartsError, pack, shortened, upright
from svbrdfgan.asset.shared_texels import texel_use

log = logging.getLogger(__name__)

LARGEST_SIZE = 8192
"""Texels along a side to which a texture grows for charts that do not fit."""

_PACKINGS = 3  # at most: a new packing has new texels, at which further faces can be found to overlap
_DOUBLED = 1e-4  # share of texels that may show two places


def second_uv_set(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"] | None, size: int, gutter: int = 4
) -> Float[ndarray, "faces 3 2"]:
    """Corner UVs in [0, 1] that are one-to-one, with one density of texels all over the surface.

    The asset's own islands are kept where they are sound: turned and moved, but whole. Mirrored twins both get a place.
    All else gets charts by xatlas. Faces without area in space become points of a neighbour's chart.

    Args:
        positions: corners of one material's faces, over all nodes, in world space.
        uv: own UVs, if there are any.
        size: texels along a side.
        gutter: least number of texels between charts.

    Raises:
        ChartsError: there are too many charts for the size.
        AssetError: xatlas is missing.
    """
    flat, chart = _charts(positions, uv)
    solid = chart >= 0
    placed = np.full((*positions.shape[:2], 2), 0.5)
    if solid.any():
        placed[solid], count = _one_to_one(positions[solid], flat[solid], chart[solid], (size, gutter))
        log.info(
            "second UV set: %d faces in %d charts, %.0f %% of the texture used",
            *(len(positions), count, 100.0 * np.abs(signed_areas(placed[solid])).sum()),
        )
    return _with_slivers(positions, placed, solid)


def fitting_uv_set(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"] | None, size: int
) -> tuple[Float[ndarray, "faces 3 2"], int]:
    """A second UV set, and the size that holds it: the given one, or doubled until the charts fit.

    Raises:
        ChartsError: the charts do not fit the largest size.
        AssetError: xatlas is missing.
    """
    while True:
        try:
            return second_uv_set(positions, uv, size), size
        except ChartsError:
            if 2 * size > LARGEST_SIZE:
                raise
        size *= 2


def _charts(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"] | None
) -> tuple[Float[ndarray, "faces 3 2"], Int[ndarray, " faces"]]:
    """Faces in the plane, in units of length, and their charts; -1 for faces without area."""
    flat, chart = np.zeros((*positions.shape[:2], 2)), np.full(len(positions), -1, dtype=np.int64)
    if uv is not None:
        flat, chart = own_charts(positions, uv)
    for method in (new_charts, box_charts):  # the second for faces that xatlas makes lines of
        rest = np.flatnonzero((chart < 0) & (areas(positions) > 0.0))
        if len(rest):
            flat[rest], found = method(positions[rest])
            chart[rest] = np.where(found >= 0, found + chart.max() + 1, -1)
    chart[chart >= 0] = np.unique(chart[chart >= 0], return_inverse=True)[1]
    return flat, chart


def _one_to_one(
    positions: Float[ndarray, "faces 3 3"],
    flat: Float[ndarray, "faces 3 2"],
    chart: Int[ndarray, " faces"],
    room: tuple[int, int],
) -> tuple[Float[ndarray, "faces 3 2"], int]:
    """The packed charts and their number. Charts that overlap themselves are cut, and all packed again."""
    flat = upright(flat, chart)
    chart = shortened(flat, chart)
    for _ in range(_PACKINGS):
        placed = pack(flat, chart, *room)
        parted, doubled = _parted(positions, placed, chart, room[0])
        if doubled <= _DOUBLED:
            break
        chart = parted
    return placed, int(chart.max()) + 1


def _parted(
    positions: Float[ndarray, "faces 3 3"],
    placed: Float[ndarray, "faces 3 2"],
    chart: Int[ndarray, " faces"],
    size: int,
) -> tuple[Int[ndarray, " faces"], float]:
    """The charts, after faces that lie on others of their chart have left it, and the share of texels with such faces.

    Only texels' centres are looked at.
    """
    use = texel_use(positions, placed, size, size)
    face, texel = use.face[use.doubled], use.texel[use.doubled]
    share = len(face) / max(len(use.face), 1)
    while True:
        key = texel * (int(chart.max()) + 1) + chart[face]
        order = np.lexsort((face, key))
        upper = face[order[1:]][key[order[1:]] == key[order[:-1]]]
        if not len(upper):
            return chart, share
        taken = np.zeros(len(chart), dtype=bool)
        taken[upper] = True
        chart = cut(positions, chart, taken)


def _with_slivers(
    positions: Float[ndarray, "faces 3 3"], placed: Float[ndarray, "faces 3 2"], solid: Bool[ndarray, " faces"]
) -> Float[ndarray, "faces 3 2"]:
    """Each face without a chart becomes one point, where a face of a chart has one of its corners."""
    vertex = welded(positions)
    spot = np.full((int(vertex.max(initial=0)) + 1, 2), 0.5)
    spot[vertex[solid].reshape(-1)] = placed[solid].reshape(-1, 2)
    placed[~solid] = spot[vertex[~solid, 0]][:, None]
    return placed
