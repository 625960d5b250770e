"""What recipes go by, at any point of a mesh: the side that is seen, visibility and curvature."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from numpy import ndarray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from svbrdfgan.asset.points import SurfacePoints
from svbrdfgan.geometry.cells import ranges
from svbrdfgan.geometry.normals import corner_normals, face_areas, face_normals, unit
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.io.rows import merge_rows
from svbrdfgan.types import Mesh, Surface
from svbrdfgan.weathering.edges import SharpEdges
from svbrdfgan.weathering.mesh_maps import EDGE_REACH, survey_maps
from svbrdfgan.weathering.occlusion import ambient_visibility
from svbrdfgan.weathering.site import Site
from svbrdfgan.weathering.survey import Grounds

_SPACING = 0.02  # of nodes on large faces, in lengths of the model: what occlusion resolves
_FINEST = 64  # divisions of an edge at most
_MOST_NODES = 2_000_000
"""Of all faces, about: twelve whole assets had up to 104,000. More are of faces that lie on each other by thousands."""
_ENCLOSED = 0.07
"""Visibility up to which a point counts as enclosed; of a closed box in a closed box it is 0.06."""
_PROBES = 16  # faces of each sheet at which its two sides are compared


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Visibility and curvature at the nodes of a regular lattice on each face, interpolated between them.

    Attributes:
        mesh: the whole model, nose at +Z.
        grounds: what all its sites share.
        normals: unit shading normals at face corners, of the side that is seen.
        reversed: faces that are seen from the side that their winding calls the back.
        divisions: parts that the edges of each face are cut into.
        start: each face's first node.
        node: of each node of each face, the index into `values`; nodes of neighbours share them.
        values: visibility and curvature.
        substance: of each face.
    """

    mesh: Mesh
    grounds: Grounds
    normals: Float[ndarray, "faces 3 3"]
    reversed: Bool[ndarray, " faces"]
    divisions: Int[ndarray, " faces"]
    start: Int[ndarray, " faces"]
    node: Int[ndarray, " nodes"]
    values: Float[ndarray, "values 2"]
    substance: UInt8[ndarray, " faces"]

    @classmethod
    def of(
        cls, mesh: Mesh, substance: UInt8[ndarray, " faces"] | None = None, metres: float | None = None
    ) -> Surroundings:
        """The surroundings of all faces; takes about a second for 60,000 nodes.

        Args:
            substance: of each face; by default all are painted sheet.
            metres: length of the model; by default as `likely_length` says.
        """
        surface = surface_over(mesh, np.zeros((len(mesh.faces), 3, 2)))
        grounds = Grounds.of(surface, metres)
        painted = np.zeros(len(mesh.faces), np.uint8) if substance is None else substance
        back = _seen_from_behind(mesh, surface)
        normals = corner_normals(mesh.positions, mesh.faces) * np.where(back, -1.0, 1.0)[:, None, None]
        divisions = _divisions(mesh, _SPACING * grounds.length)
        nodes = (divisions + 1) * (divisions + 2) // 2
        start = np.cumsum(nodes) - nodes
        points = _lattice(divisions)
        # coordinates in float32: the nodes of two faces at their edge differ by rounding
        position, normal = points.positions(mesh), unit(points.interpolate(normals))
        rows = np.column_stack([position.astype(np.float32), np.round(normal, 2)]).astype(np.float64)
        merged, node = merge_rows(rows)
        values = np.stack(survey_maps(surface, merged[:, :3], unit(merged[:, 3:])), axis=1)
        return cls(mesh, grounds, normals, back, divisions, start, node, values, painted)

    @cached_property
    def edges(self) -> SharpEdges:
        """The sharp edges of the mesh, found when they are first asked for: they take up to 1.5 KB a face."""
        return SharpEdges.of(_turned(self.mesh, self.reversed))

    def site(self, points: SurfacePoints, texel: float, *, edges: bool = True) -> Site:
        """The site at points, `texel` metres apart: recipes paint nothing finer.

        Args:
            edges: whether the distances to edges are looked up.
        """
        visibility, curvature = self.visibility_and_curvature(points)
        position, normal = points.positions(self.mesh), unit(points.interpolate(self.normals))
        distances = self.edges.distances(position, normal, EDGE_REACH * self.grounds.length) if edges else None
        substance = self.substance[points.face]
        return self.grounds.site(position, normal, visibility, curvature, texel, edges=distances, substance=substance)

    def seen(self) -> Bool[ndarray, " faces"]:
        """Faces that are not enclosed all over, as frames of seats are."""
        best: Float[ndarray, " faces"] = np.maximum.reduceat(self.values[self.node, 0], self.start)
        return best > _ENCLOSED

    def visibility_and_curvature(self, points: SurfacePoints) -> Float[ndarray, "2 points"]:
        """Both at points, as of mesh maps."""
        nodes, weights = self._around(points)
        found: Float[ndarray, "2 points"] = np.einsum("pk,pkv->vp", weights, self.values[self.node[nodes]])
        return found

    def _around(self, points: SurfacePoints) -> tuple[Int[ndarray, "points 3"], Float[ndarray, "points 3"]]:
        """The nodes of the lattice's triangle around each point, and their weights."""
        d, across = self.divisions[points.face], points.barycentric[:, 1:] * self.divisions[points.face, None]
        i = np.clip(across[:, 0].astype(np.int64), 0, d - 1)
        j = np.clip(across[:, 1].astype(np.int64), 0, d - 1 - i)
        x, y = across[:, 0] - i, across[:, 1] - j
        far = (x + y > 1.0) & (i + j < d - 1)
        first = np.where(far, _number(i + 1, j + 1, d), _number(i, j, d))
        nodes = np.stack([first, _number(i + 1, j, d), _number(i, j + 1, d)], axis=1)
        near_weights = np.stack([1.0 - x - y, x, y], axis=1)
        far_weights = np.stack([x + y - 1.0, 1.0 - y, 1.0 - x], axis=1)
        return self.start[points.face, None] + nodes, np.where(far[:, None], far_weights, near_weights)


def _number(i: ndarray, j: ndarray, d: ndarray) -> Int[ndarray, " n"]:
    """The number of node (i, j) of a face with d divisions, where j runs from 0 to d - i."""
    number: Int[ndarray, " n"] = i * (d + 1) - i * (i - 1) // 2 + j
    return number


def _divisions(mesh: Mesh, spacing: float) -> Int[ndarray, " faces"]:
    corners = mesh.positions[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    divisions = np.clip(np.ceil(longest / spacing), 1, _FINEST).astype(np.int64)
    excess = float((divisions**2 // 2).sum()) / _MOST_NODES
    return divisions if excess <= 1.0 else np.maximum(divisions / np.sqrt(excess), 1).astype(np.int64)


def _lattice(divisions: Int[ndarray, " faces"]) -> SurfacePoints:
    """All nodes of all faces, in the order of `_number`."""
    face, row = ranges(np.zeros_like(divisions), divisions + 1)
    line, col = ranges(np.zeros_like(row), divisions[face] + 1 - row)
    owner, i = face[line], row[line]
    d = divisions[owner]
    weights = np.stack([d - i - col, i, col], axis=1) / d[:, None]
    return SurfacePoints(owner, weights)


def _turned(mesh: Mesh, back: Bool[ndarray, " faces"]) -> Surface:
    """The mesh with faces wound so that the side that is seen is their front."""
    faces = np.where(back[:, None], mesh.faces[:, ::-1], mesh.faces)
    return surface_over(replace(mesh, faces=faces), np.zeros((len(faces), 3, 2)))


def _seen_from_behind(mesh: Mesh, surface: Surface) -> Bool[ndarray, " faces"]:
    """Faces whose back is more visible than their front, decided together for each sheet of one winding."""
    sheet = _sheets(mesh)
    areas, flat = face_areas(mesh.positions, mesh.faces), face_normals(mesh.positions, mesh.faces)
    order = np.lexsort((-areas, sheet))
    rank = np.arange(len(order)) - np.searchsorted(sheet[order], sheet[order])
    probe = order[rank < _PROBES]  # the largest faces of each sheet
    centres = mesh.positions[mesh.faces[probe]].mean(axis=1)
    front, back = (ambient_visibility(surface, centres, side * flat[probe]) for side in (1.0, -1.0))
    votes = np.bincount(sheet[probe], areas[probe] * (back - front), sheet.max() + 1)
    turned: Bool[ndarray, " faces"] = votes[sheet] > 0.0
    return turned


def _sheets(mesh: Mesh) -> Int[ndarray, " faces"]:
    """The number of each face's sheet: faces that share edges which both run through the opposite way."""
    start, end = mesh.faces.ravel(), np.roll(mesh.faces, -1, axis=1).ravel()
    face, vertices = np.repeat(np.arange(len(mesh.faces)), 3), len(mesh.positions)
    forward, backward = start * vertices + end, end * vertices + start
    order = np.argsort(forward, kind="stable")
    place = np.minimum(np.searchsorted(forward[order], backward), len(order) - 1)
    twin = order[place]
    meets = forward[twin] == backward
    links = coo_matrix((np.ones(meets.sum()), (face[meets], face[twin[meets]])), (len(mesh.faces),) * 2)
    number: Int[ndarray, " faces"] = connected_components(links, directed=False)[1]
    return number
