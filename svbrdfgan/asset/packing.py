"""Charts placed side by side in the unit square, by xatlas."""

from __future__ import annotations

import importlib
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.asset.islands import signed_areas
from svbrdfgan.errors import AssetError
from svbrdfgan.io.rows import merge_rows

_STEP = 0.95  # the ratio of the scales that are tried
_TRIES = 40  # to a scale of an eighth of the first guess
_DOUBTFUL = 3  # tries after which the last one is made, since where that fails all do: gutters alone fill the square
_LONGEST = 1.2  # of the side of a square of the charts' area: about the side of the texture that they fill
_GROWTHS = 4  # further scales after the first that fits
_SHRUNK = 0.97  # xatlas shrinks charts that are longer than the square
_ASLEEP = 0.01  # seconds after which threads without work sleep
_PATIENCE = 5.0  # seconds after which they are believed to
_THREADS = Path("/proc/self/task")

_Charts = tuple[Float[ndarray, "vertices 2"], Int[ndarray, "faces 3"], Int[ndarray, " faces"]]


class ChartsError(AssetError):
    """There are too many charts for the size of a texture."""


def import_xatlas() -> Any:
    """The module xatlas.

    Raises:
        AssetError: it is not installed.
    """
    try:
        return importlib.import_module("xatlas")
    except ImportError as error:
        raise AssetError(
            "a second UV set needs xatlas, which is not installed; pip install svbrdfgan[gltf]."
        ) from error


@contextmanager
def new_atlas(xatlas: Any) -> Iterator[Any]:
    """An empty atlas of the module xatlas, whose threads sleep when the block ends.

    When Python deletes an atlas, xatlas 0.0.11 signals its threads to end, and waits for them. A thread that is just
    falling asleep misses the signal, since xatlas does not hold its lock then; so the wait would never end.
    """
    others = _threads()
    try:
        yield xatlas.Atlas()
    finally:
        time.sleep(_ASLEEP)
        until = time.monotonic() + _PATIENCE
        while "R" in [state for thread, state in _threads().items() if thread not in others]:
            if time.monotonic() > until:
                break
            time.sleep(_ASLEEP)


def _threads() -> dict[str, str]:
    """The state of each thread of this process by its number, R if it runs or waits for a core; none off Linux."""
    found = {}
    for path in _THREADS.glob("*/stat"):
        with suppress(OSError):  # it has ended
            found[path.parent.name] = path.read_text(errors="replace").rpartition(")")[2].split()[0]
    return found


def pack(
    flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"], size: int, gutter: int
) -> Float[ndarray, "faces 3 2"]:
    """Corner UVs in [0, 1]: charts moved, perhaps turned by right angles, and scaled by one factor, as large as fits.

    Args:
        flat: corners in the plane of each chart. Charts are packed as they are, even if they overlap themselves.
        chart: of each face, numbered from 0.
        size: texels along a side.
        gutter: texels between charts.

    Raises:
        ChartsError: there are too many charts for the size.
        AssetError: xatlas is missing.
    """
    texels = _guess(flat, chart, size, gutter)
    mesh = (
        *_spread(flat * texels, chart),
        chart,
    )  # xatlas' tolerances are absolute: it needs numbers near those of texels
    scales = _STEP ** np.arange(_TRIES)
    for number, scale in enumerate(scales) if texels > 0.0 else ():
        if number == _DOUBTFUL and _placed(mesh, (size, gutter, scales[-1])) is None:
            break
        if (placed := _placed(mesh, (size, gutter, scale))) is not None:
            return _grown(mesh, (size, gutter, scale), placed) / size
    raise ChartsError(
        f"{chart.max() + 1} charts do not fit {size} x {size} texels with gutters of {gutter}; "
        "ask for a larger texture, or simplify the mesh."
    )


def upright(flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> Float[ndarray, "faces 3 2"]:
    """The charts turned so that the areas of their bounding boxes are about the smallest."""
    order = np.argsort(chart, kind="stable")
    points, starts = flat[order], np.searchsorted(chart[order], np.arange(int(chart.max()) + 1))
    best, least = np.zeros(len(starts)), np.full(len(starts), np.inf)
    for steps in (np.arange(0.0, 90.0, 5.0), np.arange(-2.5, 2.6, 0.5)):  # ties keep the first: as the artist had them
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
    low, high = _boxes(flat, chart)
    side = int(np.ceil(np.sqrt(len(low))))
    cell = 1.1 * float((high - low).max())
    offset = cell * np.stack(np.divmod(np.arange(len(low)), side), axis=1) - low
    vertices, index = merge_rows((flat + offset[chart][:, None]).reshape(-1, 2).astype(np.float32).astype(np.float64))
    return vertices, index.reshape(-1, 3)


def shortened(flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> Int[ndarray, " faces"]:
    """The charts, with those that are longer than the square cut across, so that they do not make all others small.

    Charts must be upright.
    """
    low, high = _boxes(flat, chart)
    sides = high - low
    limit = _LONGEST * float(np.sqrt(np.abs(signed_areas(flat)).sum()))
    pieces = np.minimum(np.ceil(sides.max(axis=1) / limit), len(flat))  # no more than there are faces
    along = np.where(sides[chart, 0] >= sides[chart, 1], *(flat.mean(axis=1) - low[chart]).T) / sides.max(axis=1)[chart]
    piece = np.minimum(np.floor(along * pieces[chart]), pieces[chart] - 1).astype(np.int64)
    return np.unique(chart * (int(pieces.max()) + 1) + piece, return_inverse=True)[1]


def _guess(flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"], size: int, gutter: int) -> float:
    """Texels per unit at which bounding boxes with gutters fill the square, or 0 if gutters alone are too many."""
    low, high = _boxes(flat, chart)
    sides = high - low
    least, most = 0.0, size / float(sides.max())
    if (gutter + 1) ** 2 * len(sides) >= size**2:
        return 0.0
    for _ in range(40):
        middle = (least + most) / 2.0
        fits = np.prod(sides * middle + gutter + 1.0, axis=1).sum() <= size**2
        least, most = (middle, most) if fits else (least, middle)
    return least


def _boxes(flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]) -> tuple[ndarray, ndarray]:
    """Lower and upper corners of each chart's bounding box."""
    count = int(chart.max()) + 1
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, chart, flat.min(axis=1))
    np.maximum.at(high, chart, flat.max(axis=1))
    return low, high


def _grown(mesh: _Charts, room: tuple[int, int, float], placed: ndarray) -> Float[ndarray, "faces 3 2"]:
    """Corners in texels, larger than `placed` as long as they fit."""
    size, gutter, scale = room
    for _ in range(_GROWTHS):
        scale /= _STEP
        if (larger := _placed(mesh, (size, gutter, scale))) is None:
            break
        placed = larger
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
    options = xatlas.PackOptions()
    options.resolution, options.texels_per_unit, options.bilinear = size, scale, False
    options.rotate_charts_to_axis = False  # it makes points of many charts whose corners are above one another
    options.padding = (gutter + 1) // 2  # xatlas widens each chart by that much, so that two are twice as far apart
    with new_atlas(xatlas) as atlas:
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
