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
_LEAST = 0.02  # texels per unit: below that, gutters alone fill the square
_REFINED = 2  # halvings of the interval between the last scales, one too large and one that fits
_SHRUNK = 0.97  # xatlas shrinks charts that are longer than the square


_Charts = tuple[Float[ndarray, "vertices 2"], Int[ndarray, "faces 3"], Int[ndarray, " faces"]]


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
    flat = _upright(flat, chart)
    texels = size * float(np.sqrt(_FULL / max(area, 1e-300)))
    mesh = (*_spread(flat * texels, chart), chart)  # xatlas' tolerances are absolute: it needs numbers near those of texels
    scale = 1.0
    while scale > _LEAST:
        if (placed := _placed(mesh, (size, gutter, scale))) is not None:
            return _refined(mesh, (size, gutter, scale), placed) / size
        scale *= _SMALLER
    raise AssetError(
        f"{chart.max() + 1} charts do not fit {size} x {size} texels with gutters of {gutter}; "
        "ask for a larger texture, or simplify the mesh."
    )


def _upright(flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
    """The charts turned so that the areas of their bounding boxes are about the smallest."""
    order = np.argsort(chart, kind="stable")
    points, starts = flat[order], np.searchsorted(chart[order], np.arange(int(chart.max()) + 1))
    best, least = np.zeros(len(starts)), np.full(len(starts), np.inf)
    for steps in (np.arange(0.0, 90.0, 3.0), np.arange(-1.5, 1.6, 0.25)):  # ties keep the first: as the artist had them
        around = best
        for step in np.deg2rad(steps):
            turned = _turned(points, (around + step)[chart[order]])
            size = np.maximum.reduceat(turned.max(axis=1), starts) - np.minimum.reduceat(turned.min(axis=1), starts)
            smaller = size.prod(axis=1) < least * (1.0 - 1e-6)
            best = np.where(smaller, around + step, best)
            least = np.where(smaller, size.prod(axis=1), least)
    return _turned(flat, best[chart])


def _turned(points: Float[ndarray, "faces 3 2"], angle: Float[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.stack([cos * points[..., 0] - sin * points[..., 1], sin * points[..., 0] + cos * points[..., 1]], axis=2)


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


def _refined(mesh: _Charts, room: tuple[int, int, float], placed: ndarray) -> ndarray:
    """Corners in texels, a little larger than `placed` if they fit."""
    size, gutter, fitting = room
    step = _SMALLER
    for _ in range(_REFINED):
        step = step**0.5
        if (larger := _placed(mesh, (size, gutter, fitting / step))) is not None:
            placed, fitting = larger, fitting / step
    return np.clip(placed, 0.0, size)


def _placed(mesh: _Charts, room: tuple[int, int, float]) -> Float[ndarray, "faces 3 2"] | None:
    """Corners in texels, or None where they need more than one square.

    Args:
        mesh: vertices, faces and the chart of each face.
        room: texels along a side, gutter, and texels per unit of the vertices.
    """
    size, gutter, scale = room
    vertices, faces, chart = mesh
    xatlas = import_xatlas()
    atlas, options = xatlas.Atlas(), xatlas.PackOptions()
    options.resolution, options.texels_per_unit, options.bilinear = size, scale, False
    options.rotate_charts_to_axis = False  # it makes points of many charts whose corners are above one another
    options.padding = (gutter + 1) // 2  # xatlas widens each chart by that much, so that two are twice as far apart
    atlas.add_uv_mesh(vertices.astype(np.float32), faces.astype(np.uint32), chart.astype(np.uint32)[:, None])
    atlas.generate(xatlas.ChartOptions(), options)
    if atlas.atlas_count != 1:
        return None
    _, found, uv = atlas.get_mesh(0)
    placed = uv.astype(np.float64)[found.reshape(-1, 3)] * (atlas.width, atlas.height)
    piece = np.full(len(faces), -1, dtype=np.int64)  # xatlas parts charts that hang together by a corner only
    for number in range(atlas.get_mesh_chart_count(0)):
        piece[np.asarray(atlas.get_mesh_chart(0, number).faces, dtype=np.int64)] = number
    known = piece >= 0
    unsnapped = _unsnapped(vertices[faces[known]] * scale, placed[known], piece[known])
    if unsnapped is None:
        return None
    placed[known] = unsnapped
    return placed


def _unsnapped(
    flat: Float[ndarray, "faces 3 2"], placed: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]
) -> Float[ndarray, "faces 3 2"] | None:
    """The charts turned and moved to where they were placed, or None if the longest was placed in a smaller size.

    xatlas stretches charts to whole texels, and makes points of those below half a texel: only places are taken.
    """
    corner = np.repeat(chart, 3)
    flat, _ = _centred(flat.reshape(-1, 2), corner)
    placed, place = _centred(placed.reshape(-1, 2), corner)
    sums = [np.bincount(corner, placed[:, i] * flat[:, j]) for i in (0, 1) for j in (0, 1)]
    left, size, right = np.linalg.svd(np.stack(sums, axis=1).reshape(-1, 2, 2))
    length = np.bincount(corner, np.square(flat).sum(axis=1))
    longest = np.argmax(_extents(flat, corner))
    if size[longest].sum() < _SHRUNK * length[longest]:
        return None
    return (np.einsum("cxy,cy->cx", (left @ right)[corner], flat) + place[corner]).reshape(-1, 3, 2)


def _centred(
    points: Float[ndarray, "points 2"], group: Int[ndarray, " points"]
) -> tuple[Float[ndarray, "points 2"], Float[ndarray, "groups 2"]]:
    """Points relative to the mean of their group, and the means."""
    mean = np.stack([np.bincount(group, axis) for axis in points.T], axis=1) / np.bincount(group)[:, None]
    return points - mean[group], mean


def _extents(points: Float[ndarray, "points 2"], group: Int[ndarray, " points"]) -> Float[ndarray, " groups"]:
    """The greatest distance of a point from its group's middle."""
    far = np.zeros(int(group.max()) + 1)
    np.maximum.at(far, group, np.linalg.norm(points, axis=1))
    return far
