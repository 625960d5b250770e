"""Charts of a surface: pieces that lie flat, in units of length. The asset's own where sound, else those of xatlas."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.asset.box_charts import box_charts
from svbrdfgan.asset.islands import areas, components, edge_neighbours, extent, signed_areas, uv_islands, welded
from svbrdfgan.asset.packing import import_xatlas, new_atlas

_STRETCH = 2.0  # the most that an own island may be longer or shorter in UV than in space
_STRETCHED = 0.05  # share of an island's area that may be stretched more
_UNITS = 1000.0  # of a surface's extent, for xatlas: its tolerances are absolute
_MOST = 100_000  # faces that are left to xatlas
_CROWD = 1_000  # faces at one vertex, likewise
_CONFETTI = 4.0  # own islands of fewer faces than this, on average, are no help to an artist


def own_charts(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"]
) -> tuple[Float[ndarray, "faces 3 2"], Int[ndarray, " faces"]]:
    """The islands of a UV map in units of length, and the chart of each face; -1 where the island is not sound.

    Each island is sheared and scaled once, as a whole, so that its lengths are as near as possible to those in space.
    Mirrored islands are turned over.
    """
    island, area = uv_islands(positions, uv), areas(positions)
    signed = signed_areas(uv)
    flat = np.einsum("fxy,fcy->fcx", _root(_metric(positions, uv, island)), uv)
    scale = np.bincount(island, area) / np.maximum(np.bincount(island, np.abs(signed_areas(flat))), 1e-300)
    flat = flat * np.sqrt(scale)[island][:, None, None]
    flat[signed < 0, :, 0] *= -1.0
    bad = (_stretch(positions, flat) > _STRETCH) | (signed == 0.0)
    sound = np.bincount(island, area * bad) <= _STRETCHED * np.bincount(island, area)
    kept = sound[island] & (signed != 0.0)
    chart = np.full(len(uv), -1, dtype=np.int64)
    chart[kept] = np.unique(island[kept], return_inverse=True)[1]
    if kept.sum() < _CONFETTI * (chart.max(initial=-1) + 1):
        chart[:] = -1
    return flat, chart


def new_charts(positions: Float[ndarray, "faces 3 3"]) -> tuple[Float[ndarray, "faces 3 2"], Int[ndarray, " faces"]]:
    """Charts in units of length, and the chart of each face; -1 for faces without area.

    xatlas finds them, save on large meshes, where rough ones take it minutes, and where thousands of faces meet. There,
    faces are grouped by axis. One iteration: further ones take longer and leave as many charts. Packing, which xatlas
    does too, is made cheap.
    """
    used, faces = np.unique(welded(positions), return_inverse=True)
    if len(positions) > _MOST or np.bincount(faces.reshape(-1)).max() > _CROWD:
        return _to_length(positions, *box_charts(positions))
    xatlas = import_xatlas()
    points = np.zeros((len(used), 3))
    scaled = (positions - positions.mean(axis=(0, 1))) * (_UNITS / extent(positions))
    points[faces.reshape(-1)] = scaled.reshape(-1, 3)
    charting, packing = xatlas.ChartOptions(), xatlas.PackOptions()
    charting.max_iterations = 1
    packing.resolution, packing.padding, packing.bilinear = 256, 0, False
    with new_atlas(xatlas) as atlas:
        atlas.add_mesh(points.astype(np.float32), faces.reshape(-1, 3).astype(np.uint32))
        atlas.generate(charting, packing)
    _, index, uv = atlas.get_mesh(0)
    chart = np.full(len(positions), -1, dtype=np.int64)
    for number in range(atlas.get_mesh_chart_count(0)):
        chart[np.asarray(atlas.get_mesh_chart(0, number).faces, dtype=np.int64)] = number
    return _to_length(positions, uv.astype(np.float64)[index] * (atlas.width, atlas.height), chart)


def cut(
    positions: Float[ndarray, "faces 3 3"], chart: Int[ndarray, " faces"], taken: Bool[ndarray, " faces"]
) -> Int[ndarray, " faces"]:
    """The charts after the taken faces have left theirs: connected ones of one chart are a new chart together."""
    one, other = edge_neighbours(welded(positions))
    same = (chart[one] == chart[other]) & (taken[one] == taken[other])
    piece = components(len(chart), one[same], other[same])
    touched = np.isin(chart, chart[taken])  # what remains of a chart can be in pieces, too
    return np.unique(np.where(touched, piece + chart.max() + 1, chart), return_inverse=True)[1]


def _to_length(
    positions: Float[ndarray, "faces 3 3"], flat: Float[ndarray, "faces 3 2"], chart: Int[ndarray, " faces"]
) -> tuple[Float[ndarray, "faces 3 2"], Int[ndarray, " faces"]]:
    """The same charts, scaled to their areas in space and not mirrored; faces without area in the plane leave them."""
    signed = signed_areas(flat)
    held = np.abs(signed)
    chart = np.where(held > 0.0, chart, -1)
    placed = chart >= 0
    wanted = np.bincount(chart[placed], areas(positions)[placed])
    scale = np.ones(len(flat))
    scale[placed] = np.sqrt(wanted / np.maximum(np.bincount(chart[placed], held[placed]), 1e-300))[chart[placed]]
    mirrored = np.zeros(len(flat), dtype=bool)
    mirrored[placed] = (np.bincount(chart[placed], signed[placed]) < 0.0)[chart[placed]]
    flat = flat * scale[:, None, None]
    flat[mirrored, :, 0] *= -1.0  # xatlas packs charts of negative area as points
    return flat, chart


def _edges(
    positions: Float[ndarray, "faces 3 3"], flat: Float[ndarray, "faces 3 2"]
) -> tuple[Float[ndarray, "faces 3 2"], Float[ndarray, "faces 2 2"]]:
    """Two edges of each face in space and in the plane, as columns."""
    return (np.swapaxes(corners[:, 1:] - corners[:, :1], 1, 2) for corners in (positions, flat))  # type: ignore[return-value]


def _face_metrics(
    positions: Float[ndarray, "faces 3 3"], flat: Float[ndarray, "faces 3 2"]
) -> Float[ndarray, "faces 2 2"]:
    """The square of lengths in space, as a form of lengths in the plane, times the area in the plane."""
    space, plane = _edges(positions, flat)
    area = signed_areas(flat)
    turned = np.stack([plane[:, 1, 1], -plane[:, 0, 1], -plane[:, 1, 0], plane[:, 0, 0]], axis=1).reshape(-1, 2, 2)
    map_ = space @ turned / np.where(area != 0.0, 2.0 * area, np.inf)[:, None, None]
    return np.swapaxes(map_, 1, 2) @ map_ * np.abs(area)[:, None, None]


def _metric(
    positions: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"], island: Int[ndarray, " faces"]
) -> Float[ndarray, "faces 2 2"]:
    """Mean metric of each face's island; that of the plane where the island has no area."""
    sums = np.stack([np.bincount(island, values) for values in _face_metrics(positions, uv).reshape(-1, 4).T], axis=1)
    good = np.linalg.det(sums.reshape(-1, 2, 2)) > 0.0
    return np.where(good[:, None, None], sums.reshape(-1, 2, 2), np.eye(2))[island]


def _root(metric: Float[ndarray, "faces 2 2"]) -> Float[ndarray, "faces 2 2"]:
    """Square roots of symmetric positive matrices."""
    root_det = np.sqrt(np.maximum(np.linalg.det(metric), 0.0))
    trace = metric[:, 0, 0] + metric[:, 1, 1]
    root_trace = np.sqrt(trace + 2.0 * root_det)
    return (metric + root_det[:, None, None] * np.eye(2)) / root_trace[:, None, None]


def _stretch(positions: Float[ndarray, "faces 3 3"], flat: Float[ndarray, "faces 3 2"]) -> Float[ndarray, " faces"]:
    """The greatest factor between lengths in space and in the plane, either way."""
    area = np.maximum(np.abs(signed_areas(flat)), 1e-300)
    values = np.linalg.eigvalsh(_face_metrics(positions, flat) / area[:, None, None])
    return np.sqrt(np.maximum(values[:, 1], 1.0 / np.maximum(values[:, 0], 1e-300)))
