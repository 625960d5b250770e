"""Charts placed side by side in the unit square, by xatlas."""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.asset.islands import signed_areas
from svbrdfgan.errors import AssetError
from svbrdfgan.io.rows import merge_rows

_FULL = 0.85  # of the square: more than charts ever fill, gutters included
_SMALLER = 0.9  # the ratio of the scales that are tried first
_LEAST = 0.02  # of the first scale: below that, gutters alone fill the square
_SHRUNK = 0.99  # xatlas shrinks charts that are longer than the square; it also stretches small ones to whole texels


def import_xatlas() -> Any:
    """The module xatlas.

    Raises:
        AssetError: it is not installed.
    """
    try:
        return importlib.import_module("xatlas")
    except ImportError as error:
        raise AssetError("a second UV set needs xatlas, which is not installed; pip install svbrdfgan[gltf].") from error


def pack(
    flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"], size: int, gutter: int
) -> Float[ndarray, "faces 3 2"]:
    """Corner UVs in [0, 1], with each chart turned and moved, all scaled by one factor, as large as fits.

    Args:
        flat: corners in the plane of each chart. Charts are packed as they are, even if they overlap themselves.
        chart: of each face, numbered from 0.
        size: texels along a side.
        gutter: texels between charts.

    Raises:
        AssetError: there are too many charts for the size, or xatlas is missing.
    """
    area = float(np.abs(signed_areas(flat)).sum())
    mesh = (*_spread(flat, chart), chart)
    first = scale = size * float(np.sqrt(_FULL / max(area, 1e-300)))
    while scale > _LEAST * first:
        if (placed := _placed(mesh, (size, gutter, scale), area)) is not None:
            larger = _placed(mesh, (size, gutter, scale / np.sqrt(_SMALLER)), area)
            return np.clip((placed if larger is None else larger) / size, 0.0, 1.0)
        scale *= _SMALLER
    raise AssetError(
        f"{chart.max() + 1} charts do not fit {size} x {size} texels with gutters of {gutter}; "
        "ask for a larger texture, or simplify the mesh."
    )


def _spread(
    flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]
) -> tuple[Float[ndarray, "vertices 2"], Int[ndarray, "faces 3"]]:
    """Vertices with the charts on a grid, so that none lie on each other, and the vertices of each face."""
    count = int(chart.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(axis=1))
    np.maximum.at(high, chart, flat.max(axis=1))
    side = int(np.ceil(np.sqrt(count)))
    cell = 1.1 * float((high - low).max())
    offset = cell * np.stack(np.divmod(np.arange(count), side), axis=1) - low
    vertices, index = merge_rows((flat + offset[chart][:, None]).reshape(-1, 2).astype(np.float32).astype(np.float64))
    return vertices, index.reshape(-1, 3)


def _placed(
    mesh: tuple[Float[ndarray, "vertices 2"], Int[ndarray, "faces 3"], Int[ndarray, " faces"]],
    room: tuple[int, int, float],
    area: float,
) -> Float[ndarray, "faces 3 2"] | None:
    """Corners in texels, or None where they need more than one square.

    Args:
        mesh: vertices, faces and the chart of each face.
        room: texels along a side, gutter, and texels per unit of length.
        area: of all charts.
    """
    size, gutter, scale = room
    vertices, faces, chart = mesh
    xatlas = import_xatlas()
    atlas, options = xatlas.Atlas(), xatlas.PackOptions()
    options.resolution, options.texels_per_unit, options.bilinear = size, scale, False
    options.padding = (gutter + 1) // 2  # xatlas widens each chart by that much, so that two are twice as far apart
    atlas.add_uv_mesh(vertices.astype(np.float32), faces.astype(np.uint32), chart.astype(np.uint32)[:, None])
    atlas.generate(xatlas.ChartOptions(), options)
    if atlas.atlas_count != 1:
        return None
    _, found, uv = atlas.get_mesh(0)
    placed = uv.astype(np.float64)[found.reshape(-1, 3)] * (atlas.width, atlas.height)
    return placed if np.abs(signed_areas(placed)).sum() > _SHRUNK * area * scale**2 else None
