"""Layout of a map in the unit square: flipped and overlapping area, coverage, seams and charts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from svbrdfgan.metrics.uv.point_location import Hits, PointLocator
from svbrdfgan.metrics.uv.visibility import NEAR, VisibleSurface

TEXELS = 512  # along a side of the grid that measures overlap and coverage
_SAME = 5e-4  # UV distance below which two corners coincide


@dataclass(frozen=True)
class Layout:
    """Layout measures. Shares are of the area on the surface, except `coverage`.

    Attributes:
        flipped: share that is mirrored in UV, as seen from outside.
        overlapping: share at texels that also hold a distant place of the surface (more than 2 `NEAR` diagonals away).
        coverage: share of the unit square that is used (compactness).
        seam_length: total length of the edges whose faces are separate in UV, over the square root of the area. The
            mesh's own borders are not seams.
        charts: number of connected components in UV.
    """

    flipped: float
    overlapping: float
    coverage: float
    seam_length: float
    charts: int


def layout(visible: VisibleSurface) -> Layout:
    """The layout measures of a visible surface."""
    area, signed = visible.areas, visible.uv_areas
    total = max(float(area.sum()), 1e-300)
    overlapping, coverage = overlap_and_coverage(visible)
    edges = _shared_edges(visible)
    return Layout(
        flipped=float(area[signed < 0].sum()) / total,
        overlapping=overlapping,
        coverage=coverage,
        seam_length=float(edges.length[edges.parted].sum()) / total**0.5,
        charts=int(_charts(edges, len(visible.faces)).max(initial=-1)) + 1,
    )


def overlap_and_coverage(visible: VisibleSurface, texels: int = TEXELS) -> tuple[float, float]:
    """`Layout.overlapping` and `Layout.coverage`, sampled at the centres of texels x texels."""
    hits, crowded = crowded_texels(visible, texels)
    area, in_square = visible.areas, np.abs(visible.uv_areas)
    per_texel = (area / np.where(in_square > 0, in_square, 1.0))[hits.triangle] / texels**2
    return min(float(per_texel[crowded].sum() / max(area.sum(), 1e-300)), 1.0), len(np.unique(hits.point)) / texels**2


def crowded_texels(visible: VisibleSurface, texels: int) -> tuple[Hits, Bool[ndarray, " hits"]]:
    """Hits at the centres of texels (row * texels + column), and whether each hit's texel holds distant places."""
    hits = _at_texels(visible, texels)
    if not len(hits.point):
        return hits, np.zeros(0, dtype=bool)
    start = np.flatnonzero(np.diff(hits.point, prepend=-1))
    place = np.einsum("sk,skx->sx", hits.barycentric, visible.positions[visible.faces[hits.triangle]])
    span = np.maximum.reduceat(place, start) - np.minimum.reduceat(place, start)
    apart = np.linalg.norm(span, axis=1) > 2 * NEAR * visible.diagonal
    return hits, np.repeat(apart, np.diff(start, append=len(hits.point)))


def _at_texels(visible: VisibleSurface, texels: int) -> Hits:
    """Hits of the triangles at the texel centres, sorted by texel."""
    nothing = Hits(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    if not len(visible.faces):
        return nothing
    centre = (np.arange(texels) + 0.5) / texels
    points = np.stack(np.meshgrid(centre, centre), axis=-1).reshape(-1, 2)
    low, high = visible.uv.min(axis=(0, 1)), visible.uv.max(axis=(0, 1))
    within = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    all_found = list(PointLocator.of(visible.uv).locate(points[within]))
    if not all_found:
        return nothing
    return Hits(
        within[np.concatenate([hits.point for hits in all_found])],
        np.concatenate([hits.triangle for hits in all_found]),
        np.concatenate([hits.barycentric for hits in all_found]),
    )


@dataclass(frozen=True, eq=False)
class _Edges:
    """Pairs of faces that share an edge in space. n faces at an edge give n - 1 pairs.

    Attributes:
        faces: both face indices.
        length: length of the edge in metres, in its first pair only; zero in its other pairs, so that sums are right.
        parted: whether any faces at the edge are separate in UV.
        joined: whether the two faces of this pair are connected in UV.
    """

    faces: Int[ndarray, "pairs 2"]
    length: Float[ndarray, " pairs"]
    parted: Bool[ndarray, " pairs"]
    joined: Bool[ndarray, " pairs"]


def _shared_edges(visible: VisibleSurface) -> _Edges:
    """The pairs of faces at a common edge, found by sorting the faces' sides by their end vertices."""
    face = np.repeat(np.arange(len(visible.faces)), 3)
    ends = np.stack([visible.faces, np.roll(visible.faces, -1, axis=1)], axis=2).reshape(-1, 2)
    uv = np.stack([visible.uv, np.roll(visible.uv, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    swap = ends[:, 0] > ends[:, 1]
    ends, uv = np.where(swap[:, None], ends[:, ::-1], ends), np.where(swap[:, None, None], uv[:, ::-1], uv)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    ends, uv, face = ends[order], uv[order], face[order]
    same = (ends[1:] == ends[:-1]).all(axis=1)
    parted = same & (visible.uv_distance(uv[1:], uv[:-1]).max(axis=1, initial=0.0) > _SAME)
    edge = np.cumsum(np.concatenate([[True], ~same]))[1:][same] if len(face) else np.zeros(0, dtype=np.int64)
    pairs = np.stack([face[:-1][same], face[1:][same]], axis=1)
    any_parted = np.bincount(edge, parted[same], minlength=int(edge.max(initial=0)) + 1) > 0
    first = np.concatenate([[True], np.diff(edge) > 0])[: len(edge)]
    span = np.linalg.norm(visible.positions[ends[1:][same, 0]] - visible.positions[ends[1:][same, 1]], axis=1)
    return _Edges(pairs, np.where(first, span, 0.0), any_parted[edge], ~parted[same])


def chart_of_faces(visible: VisibleSurface) -> Int[ndarray, " faces"]:
    """Chart of each face, numbered from 0: connected components over the edges at which faces are connected in UV."""
    return _charts(_shared_edges(visible), len(visible.faces))


def _charts(edges: _Edges, faces: int) -> Int[ndarray, " faces"]:
    one, other = edges.faces[edges.joined].T
    graph = coo_matrix((np.ones(len(one), dtype=bool), (one, other)), shape=(faces, faces))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)
