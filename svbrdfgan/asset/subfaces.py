"""Find the faces of an embedded surface at points of its mesh, whose faces the embedding may have cut."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.geometry.cells import ranges
from svbrdfgan.types import Surface

_PER_CELL = 2.0  # sub-faces, about
_SINGULAR = 1e-9  # area of a sub-face, of its face


@dataclass(frozen=True, eq=False)
class SubFaces:
    """A grid over the barycentric coordinates of each face of a mesh: which sub-faces are near.

    Attributes:
        inverse: turns barycentric coordinates in the mesh's face into those in the sub-face.
        side: cells along a side of each mesh face's grid.
        start: its first cell.
        first: where each cell's sub-faces begin in `near`; one more than there are cells.
        near: sub-faces, cell by cell.
    """

    inverse: Float[ndarray, "subfaces 3 3"]
    side: Int[ndarray, " faces"]
    start: Int[ndarray, " faces"]
    first: Int[ndarray, " cells_and_one"]
    near: Int[ndarray, " entries"]

    @classmethod
    def of(cls, surface: Surface, faces: int) -> SubFaces:
        """The sub-faces of a mesh of so many faces."""
        own, corners = surface.source_face, surface.source_barycentric
        sound = np.abs(np.linalg.det(corners)) > _SINGULAR
        inverse = np.linalg.inv(np.where(sound[:, None, None], corners, np.eye(3)))
        side = np.maximum(np.ceil(np.sqrt(np.bincount(own, minlength=faces) / _PER_CELL)), 1).astype(np.int64)
        start = np.cumsum(side**2) - side**2
        number = np.flatnonzero(sound)
        low, high = (_cell(edge(corners[number, :, 1:], axis=1), side[own[number], None]) for edge in (np.min, np.max))
        entry, row = ranges(low[:, 0], high[:, 0] - low[:, 0] + 1)
        line, col = ranges(low[entry, 1], (high - low)[entry, 1] + 1)
        owner, row = number[entry[line]], row[line]
        cell = start[own[owner]] + row * side[own[owner]] + col
        order = np.argsort(cell, kind="stable")
        first = np.searchsorted(cell[order], np.arange(int((side**2).sum()) + 1))
        return cls(inverse, side, start, first, owner[order])

    def find(self, points: SurfacePoints) -> SurfacePoints:
        """The same points on the surface. A point that rounding puts beside all sub-faces is moved into the nearest."""
        side = self.side[points.face]
        at = _cell(points.barycentric[:, 1:], side[:, None])
        cell = self.start[points.face] + at[:, 0] * side + at[:, 1]
        count = self.first[cell + 1] - self.first[cell]
        face, inside = np.zeros(len(points), np.int64), np.full(len(points), -np.inf)
        barycentric = np.zeros((len(points), 3))
        for turn in range(int(count.max(initial=0))):
            left = np.flatnonzero((count > turn) & (inside < 0.0))
            if not len(left):
                break
            tried = self.near[self.first[cell[left]] + turn]
            found = np.einsum("pi,pij->pj", points.barycentric[left], self.inverse[tried])
            least = found.min(axis=1)
            better = least > inside[left]
            face[left[better]], inside[left[better]] = tried[better], least[better]
            barycentric[left[better]] = found[better]
        barycentric = np.maximum(barycentric, 0.0)
        return SurfacePoints(face, barycentric / np.maximum(barycentric.sum(axis=1, keepdims=True), 1e-12))


def _cell(barycentric: Float[ndarray, "n 2"], side: Int[ndarray, "n 1"]) -> Int[ndarray, "n 2"]:
    found: Int[ndarray, "n 2"] = np.clip((barycentric * side).astype(np.int64), 0, side - 1)
    return found
