"""Connectivity (do neighbours on the surface stay neighbours in UV?) and similarity of two surfaces' maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.spatial import cKDTree

from svbrdfgan.geometry.normals import face_normals
from svbrdfgan.geometry.sampling import faces_by_area, points_in_triangle
from svbrdfgan.metrics.uv.visibility import VisibleSurface

POINTS = 1 << 15  # twice as many change connectivity by less than 1e-4
REACH = 1 / 64  # of the square root of the area: maximum distance of neighbours on the surface
WINDOW = 4  # neighbours in UV: at most this many times as far apart as an isometry would map `REACH`
PROBES = 4096  # samples of each surface for similarity
_LIKE = 0.5  # normals agree if their cosine is greater: within 60 degrees
_DENSE = 1 << 14
_CANDIDATES = 32


@dataclass(frozen=True, eq=False)
class Samples:
    """Points spread evenly over a visible surface.

    Attributes:
        face: face of each point.
        positions: metres.
        normals: unit face normals, outward.
    """

    face: Int[ndarray, " points"]
    positions: Float[ndarray, "points 3"]
    normals: Float[ndarray, "points 3"]
    uv: Float[ndarray, "points 2"]


def spread(visible: VisibleSurface, count: int) -> Samples:
    """`count` deterministic samples, each of which stands for the same area."""
    face, weights = faces_by_area(np.cumsum(visible.areas), count), points_in_triangle(np.arange(count))
    return Samples(
        face=face,
        positions=np.einsum("pk,pkx->px", weights, visible.positions[visible.faces[face]]),
        normals=face_normals(visible.positions, visible.faces)[face],
        uv=np.einsum("pk,pkx->px", weights, visible.uv[face]),
    )


def connectivity(visible: VisibleSurface, count: int = POINTS) -> float:
    """The share of pairs of neighbours on the surface that are also neighbours in UV; 1.0 if there are no pairs.

    Neighbours on the surface are pairs of the `count` samples with a distance of at most 1/64 of the square root of the
    area, whose normals agree within 60 degrees (this excludes opposite sides of a sheet). The distance is in space, not
    along edges, because a vehicle's panels touch without sharing vertices. Neighbours in UV are at most four times as
    far apart as an isometry would map that distance.
    """
    if not len(visible.faces):
        return 1.0
    area, in_square = float(visible.areas.sum()), float(np.abs(visible.uv_areas).sum())
    samples = spread(visible, count)
    pairs = cKDTree(samples.positions).query_pairs(REACH * area**0.5, output_type="ndarray")
    one, other = pairs[np.einsum("px,px->p", *samples.normals[pairs.T]) > _LIKE].T
    stays = visible.uv_distance(samples.uv[one], samples.uv[other]) <= WINDOW * REACH * in_square**0.5
    return float(stays.mean()) if len(one) else 1.0


@dataclass(frozen=True)
class Similarity:
    """Similarity of two maps, averaged over both directions of the comparison.

    Attributes:
        mean, p90: mean and 90th percentile of the UV distance of corresponding places; 0 is the same map.
        matched: share of the samples that have a corresponding place on the other surface.
    """

    mean: float
    p90: float
    matched: float


def similarity(one: VisibleSurface, other: VisibleSurface, count: int = PROBES) -> Similarity:
    """UV distances between corresponding places of two surfaces.

    Samples of each surface are mapped from its bounding box to the other's, with a separate scale per axis, and then to
    the closest place there whose normal agrees within 60 degrees. Samples without such a place count only in `matched`.
    """
    there, back = _distances(one, other, count), _distances(other, one, count)
    both = [distances[np.isfinite(distances)] for distances in (there, back)]
    if not all(len(distances) for distances in both):
        return Similarity(float("nan"), float("nan"), 0.0)
    return Similarity(
        mean=float(np.mean([distances.mean() for distances in both])),
        p90=float(np.mean([np.quantile(distances, 0.9) for distances in both])),
        matched=float(np.mean([np.isfinite(distances).mean() for distances in (there, back)])),
    )


def _distances(one: VisibleSurface, other: VisibleSurface, count: int) -> Float[ndarray, " points"]:
    """UV distance of each sample of `one` to its corresponding place on `other`; infinite if there is none."""
    if not (len(one.faces) and len(other.faces)):
        return np.full(count, np.inf)
    samples = spread(one, count)
    size = np.maximum(np.ptp(one.bounds, axis=0), 1e-9 * one.diagonal)
    scale = np.maximum(np.ptp(other.bounds, axis=0), 1e-9 * other.diagonal) / size
    positions = other.bounds[0] + (samples.positions - one.bounds[0]) * scale
    normals = samples.normals / scale  # normals transform by the inverse transpose
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uv = _closest_uv(other, positions, normals)
    return np.where(np.isfinite(uv[:, 0]), other.uv_distance(samples.uv, np.nan_to_num(uv)), np.inf)


def _closest_uv(
    visible: VisibleSurface, positions: Float[ndarray, "points 3"], normals: Float[ndarray, "points 3"]
) -> Float[ndarray, "points 2"]:
    """UV of the closest place whose normal agrees, searched on the faces of the nearest samples; NaN if none."""
    dense = spread(visible, _DENSE)
    _, index = cKDTree(dense.positions).query(positions, k=_CANDIDATES)
    face = dense.face[index]
    like = np.einsum("pkx,px->pk", dense.normals[index], normals) > _LIKE
    weights, distance = _closest_on_triangles(
        visible.positions[visible.faces[face]], np.broadcast_to(positions[:, None], (*face.shape, 3))
    )
    best = np.argmin(np.where(like, distance, np.inf), axis=1)
    row = np.arange(len(best))
    uv = np.einsum("pk,pkx->px", weights[row, best], visible.uv[face[row, best]])
    return np.where(like.any(axis=1)[:, None], uv, np.nan)


def _closest_on_triangles(
    corners: Float[ndarray, "*n 3 3"], points: Float[ndarray, "*n 3"]
) -> tuple[Float[ndarray, "*n 3"], Float[ndarray, " *n"]]:
    """Barycentric coordinates of each triangle's closest place to its point, and their distance."""
    from trimesh.triangles import closest_point, points_to_barycentric

    triangles, wanted = corners.reshape(-1, 3, 3), points.reshape(-1, 3)
    place = closest_point(triangles, wanted)
    weights = np.clip(np.nan_to_num(points_to_barycentric(triangles, place), nan=1 / 3), 0.0, 1.0)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights.reshape(points.shape), np.linalg.norm(place - wanted, axis=1).reshape(points.shape[:-1])
