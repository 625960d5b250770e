"""Where a photographer can stand to look closely at a surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.geometry.camera_hits import SEEN_THROUGH
from svbrdfgan.geometry.normals import face_normals
from svbrdfgan.geometry.rasterize import rasterize_triangles
from svbrdfgan.geometry.sampling import upper_frames
from svbrdfgan.types import Mesh

TILT_DEGREES = 30.0
"""The greatest angle between a surface's normal and the direction that it is looked at from."""
_DIRECTIONS = 64
_PIXELS = 160
"""Along the longer side of the picture that is taken from each direction to see what is visible from there."""


@dataclass(frozen=True, eq=False)
class Viewpoints:
    """Points of a surface, each with a direction towards a camera that sees it from any distance.

    Attributes:
        points: metres.
        directions: unit vectors away from the surface, never downwards, at most `TILT_DEGREES` off its normal.
    """

    points: Float[ndarray, "count 3"]
    directions: Float[ndarray, "count 3"]


def find_viewpoints(mesh: Mesh, wanted: Bool[ndarray, " faces"], count: int) -> Viewpoints:
    """At most `count` viewpoints on the wanted faces; fewer if less of them is visible, and none if nothing is.

    Places are chosen by area, and by from how many directions they can be seen. Faces may be wound either way. The same
    mesh always has the same viewpoints.
    """
    corners = mesh.positions[mesh.faces]
    normals = face_normals(mesh.positions, mesh.faces)
    solid = np.array([np.min(part.alpha) >= SEEN_THROUGH for part in mesh.parts])[mesh.face_part]
    points, directions, weights = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros(0)]
    for frame in upper_frames(np.arange(_DIRECTIONS)):
        across, along = corners @ frame[:2].T, corners @ frame[2]
        lower, upper = across.min(axis=(0, 1)), across.max(axis=(0, 1))
        pixel = float((upper - lower).max()) / _PIXELS
        cols, rows = (np.floor((upper - lower) / pixel).astype(int) + 1).tolist()
        raster = rasterize_triangles((across - lower) / pixel, along, rows, cols, only=solid)
        face, barycentric = raster.face[raster.mask], raster.barycentric[raster.mask]
        cosine = np.abs(normals[face] @ frame[2])
        chosen = wanted[face] & (cosine >= np.cos(np.radians(TILT_DEGREES)))
        points.append(np.einsum("nj,nji->ni", barycentric[chosen], corners[face[chosen]]))
        directions.append(np.broadcast_to(frame[2], (int(chosen.sum()), 3)))
        weights.append(pixel**2 / cosine[chosen])
    weight = np.concatenate(weights)
    rng = np.random.default_rng(0)
    taken = rng.choice(
        len(weight), min(count, len(weight)), replace=False, p=weight / weight.sum() if weight.size else None
    )
    return Viewpoints(np.concatenate(points)[taken], np.concatenate(directions)[taken])
