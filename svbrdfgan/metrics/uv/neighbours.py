"""Whether neighbours on the surface stay neighbours in the map, and whether two surfaces have like maps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.spatial import cKDTree

from svbrdfgan.geometry.normals import face_normals
from svbrdfgan.geometry.sampling import faces_by_area, points_in_triangle
from svbrdfgan.metrics.uv.visibility import VisibleSurface

POINTS = 1 << 16  # as many as texels at 256 x 256
REACH = 1 / 64  # of the square root of the area: the distance of neighbours on the surface
WINDOW = 4  # times as far apart as an isometry would put them, they are no longer neighbours in UV
PROBES = 4096
_LIKE = 0.5  # cosine between like normals
_DENSE = 1 << 14
_CANDIDATES = 32


@dataclass(frozen=True, eq=False)
class Samples:
    """Points spread evenly over an outside.

    Attributes:
        face: which one each lies in.
        positions: metres.
        normals: of the face, outward.
    """

    face: Int[ndarray, " points"]
    positions: Float[ndarray, "points 3"]
    normals: Float[ndarray, "points 3"]
    uv: Float[ndarray, "points 2"]


def spread(visible: VisibleSurface, count: int) -> Samples:
    """`count` points, each for the same area; without chance."""
    face, weights = faces_by_area(np.cumsum(visible.areas), count), points_in_triangle(np.arange(count))
    return Samples(
        face=face,
        positions=np.einsum("pk,pkx->px", weights, visible.positions[visible.faces[face]]),
        normals=face_normals(visible.positions, visible.faces)[face],
        uv=np.einsum("pk,pkx->px", weights, visible.uv[face]),
    )


def connectivity(visible: VisibleSurface, count: int = POINTS) -> float:
    """The share of neighbouring places of the surface that are neighbours in the map.

    Neighbours on the surface: pairs of `count` even samples nearer to each other than 1/64 of the square root of the
    area, whose normals agree within 60 degrees (so not the two sides of a sheet). In space and not along edges, since
    the panels of a vehicle touch without being joined. Neighbours in UV: at most four times as far apart as an
    isometry would put points at that greatest distance. 1.0 where there is no pair.
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
    """How alike two maps are: the mean of both directions.

    Attributes:
        mean, p90: distance in the unit square between the same normalised place of the two; 0 is the same map.
        matched: share of the places that the other has, with a like normal.
    """

    mean: float
    p90: float
    matched: float


def similarity(one: VisibleSurface, other: VisibleSurface, count: int = PROBES) -> Similarity:
    """How far apart the same normalised place of two surfaces is in UV.

    Even samples of each are carried by the boxes around the two whole surfaces (each axis scaled on its own) to the
    other, to its closest place whose normal is within 60 degrees. Places without one do not count.
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
    """In UV, from samples of the first to the same places of the second; infinite where there is none."""
    if not (len(one.faces) and len(other.faces)):
        return np.full(count, np.inf)
    samples = spread(one, count)
    size = np.maximum(np.ptp(one.bounds, axis=0), 1e-9 * one.diagonal)
    scale = np.maximum(np.ptp(other.bounds, axis=0), 1e-9 * other.diagonal) / size
    positions = other.bounds[0] + (samples.positions - one.bounds[0]) * scale
    normals = samples.normals / scale
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uv = _closest_uv(other, positions, normals)
    return np.where(np.isfinite(uv[:, 0]), other.uv_distance(samples.uv, np.nan_to_num(uv)), np.inf)


def _closest_uv(
    visible: VisibleSurface, positions: Float[ndarray, "points 3"], normals: Float[ndarray, "points 3"]
) -> Float[ndarray, "points 2"]:
    """The UV of the closest place with a like normal, among the faces of the nearest samples; NaN if none has one."""
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
    """Barycentric coordinates of the place of each triangle that is closest to its point, and how far it is."""
    from trimesh.triangles import closest_point, points_to_barycentric

    triangles, wanted = corners.reshape(-1, 3, 3), points.reshape(-1, 3)
    place = closest_point(triangles, wanted)
    weights = np.clip(np.nan_to_num(points_to_barycentric(triangles, place), nan=1 / 3), 0.0, 1.0)
    weights /= weights.sum(axis=1, keepdims=True)
    return weights.reshape(points.shape), np.linalg.norm(place - wanted, axis=1).reshape(points.shape[:-1])
