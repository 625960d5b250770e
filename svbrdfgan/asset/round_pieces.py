"""Wheels of a mesh: its pieces that are round about one of the axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

_DIAMETER = (0.04, 0.5)  # of the longest side of the bounding box
_SIDES_EQUAL = 0.9
_SECTORS = 8
_REACH = (0.84, 1.1)  # of the radius; a regular hexagon reaches 0.87 on its flats, a square's corners 1.41
_FEWEST_CORNERS = 12


@dataclass(frozen=True, eq=False)
class Wheels:
    """Round pieces of a mesh, one for each place. A pair of wheels on one axle may be one piece.

    Attributes:
        centers: of their bounding boxes.
        radii: half of their diameter.
        widths: along the axle.
        axles: the axis that each turns about: 0, 1 or 2.
    """

    centers: Float[ndarray, "wheels 3"]
    radii: Float[ndarray, " wheels"]
    widths: Float[ndarray, " wheels"]
    axles: Int[ndarray, " wheels"]

    def turned(self, matrix: Float[ndarray, "3 3"]) -> Wheels:
        """The wheels in other axes. The matrix only permutes axes and changes signs."""
        return Wheels(self.centers @ matrix.T, self.radii, self.widths, np.abs(matrix).argmax(axis=0)[self.axles])

    def chosen(self, which: Int[ndarray, " chosen"]) -> Wheels:
        """Some of the wheels."""
        return Wheels(self.centers[which], self.radii[which], self.widths[which], self.axles[which])


def find_wheels(
    positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"], face_part: Int[ndarray, " faces"]
) -> Wheels:
    """The round pieces, about as long as wide, of a mesh whose bounding box has a longest side of one."""
    vertices, piece, corners = _pieces(faces, face_part)
    points = positions[vertices]
    order = np.argsort(piece, kind="stable")
    starts = np.flatnonzero(np.diff(piece[order], prepend=-1))
    low = np.minimum.reduceat(points[order], starts)
    high = np.maximum.reduceat(points[order], starts)
    found = []
    for axle in range(3):
        for index in _candidates(high - low, corners, axle):
            members = points[order[starts[index] : starts[index] + corners[index]]]
            middle = 0.5 * (low[index] + high[index])
            radius = 0.25 * np.delete(high[index] - low[index], axle).sum()
            if _is_round(np.delete(members - middle, axle, axis=1) / radius):
                found.append((*middle, radius, high[index, axle] - low[index, axle], axle))
    return _largest(np.array(found).reshape(-1, 6))


def _pieces(
    faces: Int[ndarray, "faces 3"], face_part: Int[ndarray, " faces"]
) -> tuple[Int[ndarray, " corners"], Int[ndarray, " corners"], Int[ndarray, " pieces"]]:
    """The vertices of each connected piece of one part, the piece that each is in, and how many each piece has."""
    keys, corner = np.unique(faces * (int(face_part.max()) + 1) + face_part[:, None], return_inverse=True)
    corner = corner.reshape(-1, 3)
    rows, cols = corner[:, :2].reshape(-1), corner[:, 1:].reshape(-1)
    links = coo_array((np.ones(len(rows), dtype=bool), (rows, cols)), shape=(len(keys), len(keys)))
    count, piece = connected_components(links, directed=False)
    return keys // (int(face_part.max()) + 1), piece.astype(np.int64), np.bincount(piece, minlength=count)


def _candidates(sides: Float[ndarray, "pieces 3"], corners: Int[ndarray, " pieces"], axle: int) -> Int[ndarray, " few"]:
    """The pieces whose bounding box is a wheel's: two sides equal, and not as wide as a ball or on an axle."""
    across = np.delete(sides, axle, axis=1)
    shorter, longer, width = across.min(axis=1), across.max(axis=1), sides[:, axle]
    equal = shorter > _SIDES_EQUAL * longer
    sized = (longer > _DIAMETER[0]) & (longer < _DIAMETER[1])
    ball = np.abs(width / np.maximum(longer, 1e-12) - 1.0) < 0.04
    return np.flatnonzero(equal & sized & ~ball & (corners >= _FEWEST_CORNERS))


def _is_round(members: Float[ndarray, "points 2"]) -> bool:
    """Whether points reach the unit circle in every direction, and none reaches far beyond."""
    reach = np.hypot(*members.T)
    sector = np.floor((np.arctan2(members[:, 1], members[:, 0]) / (2.0 * np.pi) + 0.5) * _SECTORS + 0.5).astype(int)
    farthest = np.zeros(_SECTORS)
    np.maximum.at(farthest, sector % _SECTORS, reach)
    return bool(farthest.min() > _REACH[0] and farthest.max() < _REACH[1])


def _largest(found: Float[ndarray, "found 6"]) -> Wheels:
    """One wheel for each place: the largest of those whose centre lies within another's radius."""
    kept: list[int] = []
    for index in np.argsort(-found[:, 3], kind="stable"):
        apart = np.linalg.norm(found[kept, :3] - found[index, :3], axis=1)
        if not (apart < found[kept, 3]).any():
            kept.append(int(index))
    chosen = found[kept]
    return Wheels(chosen[:, :3], chosen[:, 3], chosen[:, 4], chosen[:, 5].astype(np.int64))
