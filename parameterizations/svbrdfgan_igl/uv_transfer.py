"""Transfers UVs from a wrap to the mesh inside by closest points, and then relaxes collapsed triangles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from svbrdfgan.geometry.normals import face_areas, face_normals
from svbrdfgan.geometry.subdivide import EdgePredicate, Pieces, refine
from svbrdfgan.types import Mesh
from svbrdfgan_igl.chart import Chart
from svbrdfgan_igl.relax import Planes, bounded, misfits, relaxed

_LEAN = 0.3
"""Distance that a place moves along its normal, per unit of depth below the wrap, before its closest point is sought.

With this move, walls that stand upright on the wrap start with an area in UV; `relax` enlarges it.
"""
_AIM = 0.5  # texels: error of interpolation along an edge above which it is cut
_SMALL = 2.5  # texels: edges shorter than this are not cut
_SMALL_BELOW = 12.0  # texels: the same for edges deep below the wrap, which cameras do not see
_DEEP = 0.03  # of the longest side: edges further than this below the wrap are deep
_ROUNDS = 12
_TORN = 1.0  # times a piece's size, or two texels: allowed error of its corners against the linear map at its middle
_UNEVEN = 3.0  # factor to which the wrap's local scale is limited, relative to its mean scale
_FACING_AWAY = -0.5  # cosine between the normals of a piece and the wrap, below which the piece should be mirrored


@dataclass(frozen=True, eq=False)
class Places:
    """Points of the mesh in the chart's coordinates, with the mean normals around them (not of unit length)."""

    positions: Float[ndarray, "points 3"]
    normals: Float[ndarray, "points 3"]

    @classmethod
    def of(cls, pieces: Pieces, normals: Float[ndarray, "source_faces 3 3"]) -> Places:
        """The vertices of pieces, with normals interpolated from those at the source faces' corners."""
        found = np.zeros_like(pieces.positions)
        found[pieces.faces] = pieces.interpolate(normals)
        return cls(pieces.positions, found)

    def mixed(self, groups: Int[ndarray, "n corners"], weights: Float[ndarray, " corners"]) -> Places:
        """Weighted means of groups of points."""
        return Places(*(np.einsum("c,ncx->nx", weights, x[groups]) for x in (self.positions, self.normals)))


@dataclass(frozen=True, eq=False)
class WrapPoints:
    """The points of a wrap that belong to places.

    Attributes:
        height: signed distance above the wrap, in the chart's coordinates.
        points: the positions for which the closest points were sought.
        face: the wrap's face that holds each closest point.
    """

    uv: Float[ndarray, "points 2"]
    height: Float[ndarray, " points"]
    points: Float[ndarray, "points 3"]
    face: Int[ndarray, " points"]


@dataclass(frozen=True, eq=False)
class WrapLocator:
    """Finds the closest point of a wrap, and its UV.

    Attributes:
        texel: square root of the wrap's area divided by its area in UV: the mean length on the wrap of a unit in UV.
    """

    chart: Chart
    tree: igl.AABB
    normals: Float[ndarray, "faces 3"]
    texel: float

    @classmethod
    def of(cls, chart: Chart) -> WrapLocator:
        """The locator of a chart's surface."""
        positions, faces = chart.disk.positions, chart.disk.faces
        tree = igl.AABB()
        tree.init(positions, faces)
        flat = np.column_stack([chart.uv, np.zeros(len(chart.uv))])
        texel = float(np.sqrt(face_areas(positions, faces).sum() / face_areas(flat, faces).sum()))
        return cls(chart, tree, face_normals(positions, faces), texel)

    def at(self, places: Places) -> WrapPoints:
        """The points of the wrap that belong to the places."""
        height = self._height(places.positions)
        points = places.positions - _LEAN * height[:, None] * places.normals
        face, nearest = self._nearest(points)
        corners = self.chart.disk.faces[face]
        weights = np.clip(_barycentric(self.chart.disk.positions[corners], nearest), 0.0, 1.0)
        uv = np.einsum("pk,pkx->px", weights / weights.sum(axis=1, keepdims=True), self.chart.uv[corners])
        return WrapPoints(np.asarray(uv), height, points, face)

    def _height(self, points: Float[ndarray, "points 3"]) -> Float[ndarray, " points"]:
        """Signed distance to the wrap, negative below it."""
        face, nearest = self._nearest(points)
        away = points - nearest
        side = np.where(np.einsum("px,px->p", away, self.normals[face]) < 0.0, -1.0, 1.0)
        return np.asarray(side * np.linalg.norm(away, axis=1))

    def _nearest(
        self, points: Float[ndarray, "points 3"]
    ) -> tuple[Int[ndarray, " points"], Float[ndarray, "points 3"]]:
        disk = self.chart.disk
        _, face, nearest = self.tree.squared_distance(disk.positions, disk.faces, np.ascontiguousarray(points))
        return np.asarray(face, dtype=np.int64).ravel(), nearest

    def extrapolated(
        self, points: Float[ndarray, "n corners 3"], face: Int[ndarray, " n"]
    ) -> Float[ndarray, "n corners 2"]:
        """The UV of points by the linear map of a given face of the wrap, extrapolated beyond that face."""
        corners = self.chart.disk.faces[face]
        triangles = np.repeat(self.chart.disk.positions[corners], points.shape[1], axis=0)
        weights = _barycentric(triangles, points.reshape(-1, 3)).reshape(*points.shape)
        return np.asarray(np.clip(np.einsum("nck,nkx->ncx", weights, self.chart.uv[corners]), 0.0, 1.0))


def transfer_uv(
    wrap: WrapLocator, mesh: Mesh, resolution: int
) -> tuple[Pieces, Float[ndarray, "pieces 3 2"], Float[ndarray, "pieces 3"]]:
    """The mesh's faces cut into pieces, with the UV and the height above the wrap (metres) at each corner.

    Faces are cut until interpolating UV errs by less than half a texel, or pieces are about as small as a texel. If the
    corners of a piece are closest to distant places of the wrap, for example on the two sides of a seam, the whole
    piece takes the linear map at its middle. Finally, UVs are relaxed so that fewer pieces are collapsed.
    """
    frame = wrap.chart.frame
    positions = frame.to_unit(mesh.positions)
    normals = _vertex_normals(positions, mesh.faces)[mesh.faces]
    pieces = refine(Pieces.whole(positions, mesh.faces), _edges_that_err(wrap, normals, resolution), _ROUNDS)
    places = Places.of(pieces, normals)
    at, middle = wrap.at(places), wrap.at(places.mixed(pieces.faces, np.full(3, 1 / 3)))
    faces, uv = _split_torn(wrap, pieces.faces, at, middle.face, resolution)
    corners = _relaxed_corners(wrap, pieces, faces, uv, middle)
    return _in_metres(pieces, mesh), corners, at.height[pieces.faces] * frame.size


def _split_torn(
    wrap: WrapLocator,
    faces: Int[ndarray, "pieces 3"],
    at: WrapPoints,
    under: Int[ndarray, " pieces"],
    resolution: int,
) -> tuple[Int[ndarray, "pieces 3"], Float[ndarray, "more_vertices 2"]]:
    """Gives torn pieces vertices of their own, with UVs by the linear map of the wrap's face at their middle."""
    corners, uv = at.points[faces], at.uv
    expected = wrap.extrapolated(corners, under)
    apart = np.linalg.norm(uv[faces] - expected, axis=2).max(axis=1)
    size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1) / wrap.texel
    torn = np.flatnonzero(apart > _TORN * np.maximum(size, 2.0 / resolution))
    parted = faces.copy()
    parted[torn] = len(uv) + np.arange(3 * len(torn)).reshape(-1, 3)
    return parted, np.concatenate([uv, expected[torn].reshape(-1, 2)])


def _relaxed_corners(
    wrap: WrapLocator,
    pieces: Pieces,
    faces: Int[ndarray, "pieces 3"],
    uv: Float[ndarray, "vertices 2"],
    middle: WrapPoints,
) -> Float[ndarray, "pieces 3 2"]:
    """The relaxed UV of the corners. Pieces that stay collapsed or torn are separated from their neighbours."""
    corners = wrap.chart.disk.faces[middle.face]
    own = Planes.of(wrap.chart.disk.positions[corners]).jacobians(wrap.chart.uv[corners])
    local = bounded(own * wrap.texel, np.zeros(len(own), dtype=bool), 1 / _UNEVEN, _UNEVEN) / wrap.texel
    cosine = np.einsum("px,px->p", face_normals(pieces.positions, pieces.faces), wrap.normals[middle.face])
    planes = Planes.of(pieces.positions[pieces.faces])
    mirrored = cosine < _FACING_AWAY
    moved = relaxed(planes, faces, uv, local, mirrored)[faces]
    some, apart = misfits(planes, moved, middle.uv, local, mirrored)
    moved[some] = apart
    return _within(moved, wrap.chart.uv)


def _within(uv: Float[ndarray, "pieces 3 2"], chart: Float[ndarray, "vertices 2"]) -> Float[ndarray, "pieces 3 2"]:
    """The UV with pieces beyond the chart's bounds translated back inside, since clamping would collapse them."""
    below = np.maximum(chart.min(axis=0) - uv.min(axis=1), 0.0)
    above = np.maximum(uv.max(axis=1) - chart.max(axis=0), 0.0)
    return np.asarray(np.clip(uv + (below - above)[:, None, :], 0.0, 1.0))


def _vertex_normals(positions: Float[ndarray, "vertices 3"], faces: Int[ndarray, "faces 3"]) -> Float[ndarray, "v 3"]:
    """The area-weighted mean of the face normals around each vertex; opposite normals cancel, so it may be short."""
    weighted = face_normals(positions, faces) * face_areas(positions, faces)[:, None]
    total, weight = np.zeros_like(positions), np.zeros(len(positions))
    for k in range(3):
        np.add.at(total, faces[:, k], weighted)
        np.add.at(weight, faces[:, k], np.linalg.norm(weighted, axis=1))
    return np.asarray(total / np.maximum(weight, 1e-300)[:, None])  # faces may have no area


def _in_metres(pieces: Pieces, mesh: Mesh) -> Pieces:
    """The pieces with positions interpolated from the mesh in metres, because the chart's coordinates are rounded."""
    positions = np.zeros_like(pieces.positions)
    positions[pieces.faces] = pieces.interpolate(mesh.positions[mesh.faces])
    return replace(pieces, positions=positions)


def _edges_that_err(wrap: WrapLocator, normals: Float[ndarray, "source_faces 3 3"], resolution: int) -> EdgePredicate:
    """Chooses edges that are longer than some texels and along which interpolating UV errs, sampled at quarters."""
    texel = wrap.texel / resolution

    def wanted(
        pieces: Pieces, edges: Int[ndarray, "edges 2"], face_edges: Int[ndarray, "faces 3"]
    ) -> Bool[ndarray, " edges"]:
        ends = pieces.positions[edges]
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        long = np.flatnonzero(length > _SMALL * texel)
        places = Places.of(pieces, normals)
        at = wrap.at(places)
        deep = at.height[edges[long]].max(axis=1) < -_DEEP
        long = long[~deep | (length[long] > _SMALL_BELOW * texel)]
        worst = np.zeros(len(long))
        for t in (0.25, 0.5, 0.75):
            weights = np.array([1 - t, t])
            true = wrap.at(places.mixed(edges[long], weights)).uv
            worst = np.maximum(
                worst, np.linalg.norm(true - np.einsum("c,ecx->ex", weights, at.uv[edges[long]]), axis=1)
            )
        cut = np.zeros(len(edges), dtype=bool)
        cut[long[worst * resolution > _AIM]] = True
        return cut

    return wanted


def _barycentric(
    corners: Float[ndarray, "points 3 3"], points: Float[ndarray, "points 3"]
) -> Float[ndarray, "points 3"]:
    """Barycentric coordinates of each point's projection onto the plane of its triangle."""
    a, p, q = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(p, q)
    square = np.maximum(np.einsum("px,px->p", normal, normal), 1e-300)
    to = points - a
    b = np.einsum("px,px->p", np.cross(to, q), normal) / square
    c = np.einsum("px,px->p", np.cross(p, to), normal) / square
    return np.stack([1.0 - b - c, b, c], axis=1)
