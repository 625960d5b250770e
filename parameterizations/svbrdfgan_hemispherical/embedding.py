"""The map of the thesis's equation 4.1, over a mesh that is subdivided until interpolating UV errs by half a texel."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.errors import ConfigError, EmbeddingError
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.geometry.split import surface_from_corners
from svbrdfgan.geometry.subdivide import EdgePredicate, Pieces, refine
from svbrdfgan.protocols import UVCapabilities
from svbrdfgan.types import Mesh, Surface

log = logging.getLogger(__name__)

AXES: dict[str, Float[ndarray, "3 3"]] = {
    "z": np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "x": np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]),
}
"""A matrix for each axis of the nose, with rows: the vehicle's right (looking forward), up, and nose."""

_AIM = 0.45  # texels: allowed error at sampled points, so that it stays below half a texel between them
_ROUNDS = 24  # each halves the edges that it cuts; enough to reach the shortest edge from any length
_SHORTEST_EDGE = 1e-5  # of the model's diagonal; shorter edges are not cut, so that subdivision ends for every input


@dataclass(frozen=True, eq=False)
class Frame:
    """The origin and axes of the angles.

    Attributes:
        centre: in metres, in the mesh's coordinates; below the ground.
        axes: rows right, up and nose; unit vectors.
    """

    centre: Float[ndarray, " 3"]
    axes: Float[ndarray, "3 3"]

    @classmethod
    def of_bounds(cls, bounds: Float[ndarray, "2 3"], axis: str, centre_height: float) -> Frame:
        """The frame of a model with these bounds.

        Raises:
            EmbeddingError: the model is flat.
        """
        size = bounds[1] - bounds[0]
        if size.min() <= 1e-6 * size.max():
            shown = " x ".join(f"{s:.3g}" for s in size)
            raise EmbeddingError(
                f"the mesh is flat ({shown} m); a hemispherical embedding needs width, height and length."
            )
        if axis == "auto":
            axis = "x" if size[0] > size[2] else "z"
        centre = bounds.mean(axis=0)
        centre[1] = bounds[0, 1] + centre_height * size[1]
        return cls(centre, AXES[axis])

    def uv(self, points: Float[ndarray, "*n 3"]) -> Float[ndarray, "*n 2"]:
        """Equation 4.1 of the thesis: (theta, phi) / pi."""
        right, up, nose = np.moveaxis((points - self.centre) @ self.axes.T, -1, 0)
        theta = np.arctan2(up, right)
        phi = np.arctan2(np.hypot(right, up), nose)
        return np.stack([theta, phi], axis=-1) / np.pi

    def elevation(self, points: Float[ndarray, "*n 3"]) -> Float[ndarray, " *n"]:
        """Distance from the centre in metres; of two surfaces in one direction, the outer one has the greater."""
        return np.linalg.norm(points - self.centre, axis=-1)


@dataclass(frozen=True)
class HemisphericalEmbedding:
    """Equation 4.1 of the thesis: (u, v) = (theta / pi, phi / pi), discarding the distance from the centre.

    The poles lie along the vehicle's length. `u` turns about this axis from the vehicle's right over its roof to its
    left, and `v` runs from the nose to the tail, so that outer faces keep their winding in UV and are not mirrored.
    The centre is the middle of the bounding box in the two horizontal directions, slightly below the ground, so
    that the whole model is above it: theta stays inside (0, pi), and neither the seam nor a pole touches the surface.
    Where several surfaces share a direction, the one furthest from the centre is outermost. Angles are taken in metres:
    a measurement showed that dividing by the bounding box first makes maps of different vehicles no more alike, and
    less even.

    Attributes:
        resolution: texels along a side for which interpolating (u, v) over a triangle errs by at most half a texel.
        centre_height: height of the centre above the ground, in heights of the model, in [-1, 0). A centre nearer to
            the ground gives a map closer to a hemisphere, and more faces on the underside.
        axis: direction of the nose: "z" (+Z, the convention), "x" (+X), or "auto", the longer of the two.

    Raises:
        ConfigError: an option is out of range.
    """

    resolution: int = 256
    centre_height: float = -0.02
    axis: Literal["z", "x", "auto"] = "z"

    capabilities: ClassVar[UVCapabilities] = UVCapabilities(injective=False, subdivides=True)

    def __post_init__(self) -> None:
        if not 1 <= self.resolution <= 16384:
            raise ConfigError(f"resolution is {self.resolution}; wanted texels along a side, from 1 to 16384.")
        if not (math.isfinite(self.centre_height) and -1.0 <= self.centre_height < 0.0):
            raise ConfigError(f"centre_height is {self.centre_height}; wanted at least -1 and below 0, the ground.")
        if self.axis != "auto" and self.axis not in AXES:
            raise ConfigError(f"axis is {self.axis!r}; wanted 'z', 'x' or 'auto'.")

    def frame(self, mesh: Mesh) -> Frame:
        """The origin and axes of the angles for this mesh."""
        return Frame.of_bounds(mesh.bounds, self.axis, self.centre_height)

    def embed(self, mesh: Mesh) -> Surface:
        """The mesh over the unit square, subdivided.

        Raises:
            EmbeddingError: the mesh is flat.
        """
        frame = self.frame(mesh)
        pieces = refine(Pieces.whole(mesh.positions, mesh.faces), self._errs(frame, mesh), _ROUNDS)
        log.info("hemispherical embedding: %d faces became %d", len(mesh.faces), len(pieces.faces))
        normals = corner_normals(mesh.positions, mesh.faces)
        return surface_from_corners(
            pieces,
            normals=pieces.interpolate(normals),
            uv=frame.uv(pieces.positions)[pieces.faces],
            elevation=frame.elevation(pieces.positions)[pieces.faces],
            face_part=mesh.face_part[pieces.source_face],
            parts=mesh.parts,
        )

    def _errs(self, frame: Frame, mesh: Mesh) -> EdgePredicate:
        """Chooses edges on which interpolating (u, v) errs too much, and the longest edge of faces in which it does."""
        floor = _SHORTEST_EDGE * float(np.linalg.norm(mesh.bounds[1] - mesh.bounds[0]))

        def wanted(
            pieces: Pieces, edges: Int[ndarray, "edges 2"], face_edges: Int[ndarray, "faces 3"]
        ) -> Bool[ndarray, " edges"]:
            uv = frame.uv(pieces.positions)
            cut = _deviation(frame, pieces.positions[edges], uv[edges], _ON_EDGE) > _AIM / self.resolution
            inside = _deviation(frame, pieces.positions[pieces.faces], uv[pieces.faces], _IN_FACE)
            length = np.linalg.norm(pieces.positions[edges[:, 0]] - pieces.positions[edges[:, 1]], axis=1)
            bad = face_edges[inside > _AIM / self.resolution]
            cut[bad[np.arange(len(bad)), np.argmax(length[bad], axis=1)]] = True
            return cut & (length > floor)

        return wanted


_ON_EDGE = np.array([[0.75, 0.25], [0.5, 0.5], [0.25, 0.75]])
_IN_FACE = np.array([[1, 1, 1], [2, 1, 1], [1, 2, 1], [1, 1, 2]]) / [[3], [4], [4], [4]]


def _deviation(
    frame: Frame,
    corners: Float[ndarray, "simplices corners 3"],
    uv: Float[ndarray, "simplices corners 2"],
    at: Float[ndarray, "samples corners"],
) -> Float[ndarray, " simplices"]:
    """The greatest distance between the true and the interpolated (u, v) over the samples."""
    worst = np.zeros(len(corners))
    for weights in at:
        true = frame.uv(np.einsum("c,scx->sx", weights, corners))
        worst = np.maximum(worst, np.linalg.norm(true - np.einsum("c,scx->sx", weights, uv), axis=1))
    return worst
