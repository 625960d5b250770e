"""Distances from points on a surface to its sharp edges: convex ones, creases, and open borders such as panel gaps.

    edges = SharpEdges.of(surface)
    near = edges.distances(position, normal, reach=0.05)

Around each edge, the faces that meet there bound wedges of space. A wedge that the front of a face looks into makes the
edge convex, a crease or smooth by its opening angle alone, however many faces there are. So doubled faces, sheets that
are seen from both sides, inconsistent winding and ribs behind a panel need no rules of their own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from svbrdfgan.geometry.cells import ranges
from svbrdfgan.geometry.normals import unit
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.types import Surface
from svbrdfgan.utils.threads import BLOCK, by_blocks

_SHARP = math.radians(30.5)
"""The least turn of a sharp edge: a little more than between the sides of a cylinder with twelve of them."""
_SAME_SHEET = math.radians(1.0)  # faces at an edge that are closer than this are one sheet
_TOLERANCE = 1e-5  # of the bounding box's diagonal: vertices this close are welded
_SPACING = 5e-3  # of samples on an edge, likewise
_MOST_SAMPLES = 1_000_000  # besides one for each edge
_AGREE = 0.3
"""An edge counts at points whose normal has at least this cosine with one of the sides that meet at the edge."""
_FEWEST, _MOST = 8, 512  # samples around a point that are looked at


@dataclass(frozen=True, eq=False)
class EdgeDistances:
    """Metres from each point to the nearest edge of each kind, clipped to the reach.

    Attributes:
        convex: to sharp edges that stick out.
        crease: to sharp edges that lie in.
        border: to edges where a sheet ends: at gaps between panels, and wherever parts were modelled apart.
    """

    convex: Float[ndarray, " points"]
    crease: Float[ndarray, " points"]
    border: Float[ndarray, " points"]


@dataclass(frozen=True, eq=False)
class SharpEdges:
    """The sharp edges of a surface by kind, to be asked for many batches of points."""

    convex: EdgeIndex
    crease: EdgeIndex
    border: EdgeIndex

    @classmethod
    def of(cls, surface: Surface) -> SharpEdges:
        """The edges that turn by more than 30 degrees, and the borders; takes a second and 150 MB for 100,000 faces.

        Vertices of one place are welded, whatever splits them. Edges of hidden parts alone are left out. The front of a
        face is where its shading normals point: a caller that sees faces from behind reverses those first.
        """
        corners = surface.positions[surface.faces]
        size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
        positions, vertex = _weld(surface.positions, _TOLERANCE * size)
        hidden = np.array([part.hidden for part in surface.parts])[surface.face_part]
        sheets = _Sheets.of(positions, vertex[_outward(surface)], hidden & ~hidden.all(), _TOLERANCE * size)
        ends, sides, opening = _wedges(sheets)
        border = opening > 2.0 * math.pi - _SAME_SHEET / 2.0
        kinds = (opening > math.pi + _SHARP) & ~border, opening < math.pi - _SHARP, border
        return cls(*(EdgeIndex.of(ends[kind], sides[kind], _SPACING * size) for kind in kinds))

    def distances(
        self, position: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"], reach: float
    ) -> EdgeDistances:
        """The distances at points; each point's depend on that point alone.

        Only edges count that have a side whose normal agrees with the point's (see `_AGREE`), so that what lies beneath
        a panel does not show through. Distances are exact unless more than 512 samples of edges of other sides are
        nearer; then they may be too great.

        Args:
            normal: unit, outward.
            reach: metres, positive.
        """
        kinds = (self.convex, self.crease, self.border)
        return EdgeDistances(*(by_blocks(partial(kind.distance, reach=reach), position, normal) for kind in kinds))


@dataclass(frozen=True, eq=False)
class EdgeIndex:
    """Edges of one kind, with samples along them in a tree.

    Attributes:
        start: one end of each edge.
        along: from there to the other end.
        sides: unit normals of the two sides that meet at the edge; of a border, its front twice or both of its fronts.
        tree: of samples, each in the middle of a piece of an edge no longer than `spacing`.
        owner: the edge of each sample.
        spacing: metres.
    """

    start: Float[ndarray, "edges 3"]
    along: Float[ndarray, "edges 3"]
    sides: Float[ndarray, "edges 2 3"]
    tree: cKDTree
    owner: Int[ndarray, " samples"]
    spacing: float

    @classmethod
    def of(cls, ends: Float[ndarray, "edges 2 3"], sides: Float[ndarray, "edges 2 3"], spacing: float) -> EdgeIndex:
        """An index of samples about `spacing` apart, or further if they were too many."""
        start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
        length = np.linalg.norm(along, axis=1)
        spacing = max(spacing, float(length.sum()) / _MOST_SAMPLES)
        pieces = np.ceil(length / spacing).astype(np.int64)
        owner, number = ranges(np.zeros_like(pieces), pieces)
        samples = start[owner] + ((number + 0.5) / pieces[owner])[:, None] * along[owner]
        return cls(start, along, sides, cKDTree(samples), owner, spacing)

    def distance(
        self, position: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"], reach: float
    ) -> Float[ndarray, " points"]:
        """Distance to the nearest edge that counts at each point, at most `reach`."""
        found = np.full(len(position), float(reach))
        pending, count = np.arange(len(position)), min(_FEWEST, len(self.owner))
        while len(pending) and count:
            parts = np.array_split(pending, math.ceil(len(pending) * count / (_FEWEST * BLOCK)))
            unsettled = []
            for part in parts:
                found[part], settled = self._among(count, position[part], normal[part], reach)
                unsettled.append(part[~settled])
            pending = np.concatenate(unsettled)
            count = min(4 * count, len(self.owner)) if count < min(_MOST, len(self.owner)) else 0
        return found

    def _among(
        self, count: int, position: Float[ndarray, "points 3"], normal: Float[ndarray, "points 3"], reach: float
    ) -> tuple[Float[ndarray, " points"], Bool[ndarray, " points"]]:
        """The distance to the edges of the `count` nearest samples, and whether no other edge can be nearer."""
        slack = self.spacing / 2.0  # no point of an edge is further from the nearest of its samples
        gap, sample = self.tree.query(position, k=np.arange(1, count + 1), distance_upper_bound=reach + slack)
        point, rank = np.nonzero(np.isfinite(gap))
        edge = self.owner[sample[point, rank]]
        agree = np.einsum("nsi,ni->ns", self.sides[edge], normal[point]).max(axis=1) > _AGREE
        point, edge = point[agree], edge[agree]
        nearest = np.full(len(position), float(reach))
        np.minimum.at(nearest, point, _to_segment(position[point] - self.start[edge], self.along[edge]))
        return nearest, ~(gap[:, -1] - slack < nearest)


def _to_segment(offset: Float[ndarray, "n 3"], along: Float[ndarray, "n 3"]) -> Float[ndarray, " n"]:
    """Distance of points, relative to a segment's start, to the segment."""
    share = np.einsum("ni,ni->n", offset, along) / np.einsum("ni,ni->n", along, along)
    return np.linalg.norm(offset - np.clip(share, 0.0, 1.0)[:, None] * along, axis=1)


def _outward(surface: Surface) -> Int[ndarray, "faces 3"]:
    """The faces, counter-clockwise seen from where their shading normals point."""
    faces = surface.faces
    a, b, c = (surface.positions[faces[:, k]] for k in range(3))
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), surface.normals[faces].sum(axis=1)) < 0.0
    return np.where(inward[:, None], faces[:, ::-1], faces)


def _weld(
    positions: Float[ndarray, "vertices 3"], tolerance: float
) -> tuple[Float[ndarray, "welded 3"], Int[ndarray, " vertices"]]:
    """The positions, those within the tolerance made one, and the index of each vertex among them."""
    distinct, index = merge_rows(positions)
    gap, other = cKDTree(distinct).query(distinct, k=[2, 3, 4], distance_upper_bound=tolerance)
    vertex, rank = np.nonzero(np.isfinite(gap))
    links = coo_matrix((np.ones(len(vertex)), (vertex, other[vertex, rank])), (len(distinct),) * 2)
    _, group = connected_components(links, directed=False)
    _, first = np.unique(group, return_index=True)
    return distinct[first], group[index]


@dataclass(frozen=True, eq=False)
class _Sheets:
    """The half-planes around edges in which faces lie, sorted by edge and by angle.

    Attributes:
        edge: number of the edge.
        angle: around the edge from its first sheet, in [0, 2 pi).
        ends: of the edge.
        up: unit normal of the side towards greater angles.
        opens, closes: whether the side towards greater angles, and the other, is the front of a face.
        seen: whether a face is not hidden.
    """

    edge: Int[ndarray, " sheets"]
    angle: Float[ndarray, " sheets"]
    ends: Float[ndarray, "sheets 2 3"]
    up: Float[ndarray, "sheets 3"]
    opens: Bool[ndarray, " sheets"]
    closes: Bool[ndarray, " sheets"]
    seen: Bool[ndarray, " sheets"]

    @classmethod
    def of(
        cls,
        positions: Float[ndarray, "vertices 3"],
        faces: Int[ndarray, "faces 3"],
        hidden: Bool[ndarray, " faces"],
        tolerance: float,
    ) -> _Sheets:
        """The sheets of all edges, but for edges where a face is thinner than the tolerance."""
        proper = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
        start, end, apex = (np.roll(faces[proper], -k, axis=1).ravel() for k in range(3))
        low, high = np.minimum(start, end), np.maximum(start, end)
        _, first, edge = np.unique(low * len(positions) + high, return_index=True, return_inverse=True)
        axis, arm = unit(positions[high] - positions[low]), positions[apex] - positions[low]
        arm -= np.einsum("hi,hi->h", arm, axis)[:, None] * axis
        up = np.cross(axis, arm)
        angle = np.arctan2(*(np.einsum("hi,hi->h", arm, other[first][edge]) for other in (up, arm))) % (2.0 * math.pi)
        angle = np.where(angle > 2.0 * math.pi - _SAME_SHEET, 0.0, angle)
        thin = np.bincount(edge, np.linalg.norm(arm, axis=1) < tolerance) > 0.0
        half = np.lexsort((angle, edge))
        half = half[~thin[edge[half]]]
        fresh = (np.diff(edge[half], prepend=-1) != 0) | (np.diff(angle[half], prepend=0.0) > _SAME_SHEET)
        number, count = np.cumsum(fresh) - 1, int(fresh.sum())
        kinds = (start < end, start > end, ~np.repeat(hidden[proper], 3))
        flags = [np.bincount(number[kind[half]], minlength=count) > 0 for kind in kinds]
        half = half[fresh]
        ends = np.stack([positions[low[half]], positions[high[half]]], axis=1)
        return cls(edge[half], angle[half], ends, unit(up[half]), *flags)


def _wedges(
    sheets: _Sheets,
) -> tuple[Float[ndarray, "wedges 2 3"], Float[ndarray, "wedges 2 3"], Float[ndarray, " wedges"]]:
    """The wedges of space at edges that at least one front looks into, each from one sheet to the next around the edge.

    Returns:
        ends: of the edge.
        sides: unit normals of the sheets, pointing into the wedge; of a border, those of its fronts.
        opening: angle in radians: pi where the surface is flat, more where it is convex, 2 pi around an only sheet.
    """
    last = np.diff(sheets.edge, append=-1) != 0
    following = np.arange(1, len(last) + 1)
    following[last] = np.flatnonzero(np.diff(sheets.edge, prepend=-1))
    alone = following == np.arange(len(last))
    sides = np.stack([sheets.up, -sheets.up[following]], axis=1)
    sides[alone & ~sheets.opens, 0] *= -1.0
    sides[alone & ~sheets.closes, 1] *= -1.0
    opening = sheets.angle[following] + np.where(last, 2.0 * math.pi, 0.0) - sheets.angle
    chosen = (sheets.opens | sheets.closes[following]) & (sheets.seen | sheets.seen[following])
    return sheets.ends[chosen], sides[chosen], opening[chosen]
