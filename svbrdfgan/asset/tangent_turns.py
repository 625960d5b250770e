"""Normals turned from the tangent frames of one UV set into those of another.

A file without tangents has those of the UVs at which its normal map is looked up, so they change with a new UV set.
A file with tangents keeps them: there, the layer is turned, and not the file's normals.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from svbrdfgan.asset.painted_texture import NORMAL, Canvas, fill
from svbrdfgan.asset.piece_groups import Group
from svbrdfgan.asset.texture_bands import bands
from svbrdfgan.geometry.normals import corner_normals
from svbrdfgan.geometry.split import surface_over
from svbrdfgan.geometry.tangents import corner_tangents
from svbrdfgan.io.gltf.document import Json
from svbrdfgan.io.uv_sets import UVSet
from svbrdfgan.types import Mesh, Part

Turns = Float[ndarray, "mesh_faces 3 2 2"]
"""At corners of all faces of a mesh, what x and y of normals are multiplied by."""


def turns_of_file(canvas: Canvas, group: Group, normal: Json | None, own: UVSet | None) -> Turns | None:
    """What the file's normals are turned by on a canvas; None if they stay.

    Args:
        normal: the `textureInfo` of the file's normal map.
        own: the file's UVs that the canvas has, if it has any.
    """
    uv = None if normal is None or UVSet.of(normal) == own else group.uv(UVSet.of(normal))
    return None if uv is None else _turns(canvas, uv, canvas.uv, ~group.with_tangents())


def turn_layer(
    painted: Float[ndarray, "rows cols channels"], canvas: Canvas, group: Group, normal: Json | None, own: UVSet | None
) -> None:
    """Turns the normals of a painted layer, in place, into the tangents that the file has."""
    unmoved, tangents = UVSet(UVSet.of(normal or {}).number), group.with_tangents()
    uv = None if own == unmoved or not tangents.any() else group.uv(unmoved)
    if uv is None:
        return
    turns = _turns(canvas, canvas.uv, uv, tangents)
    known = np.zeros(painted.shape[:2], bool)
    for band in bands(canvas.uv, canvas.faces, *painted.shape[:2]):
        own_rows = slice(band.rows.start, band.rows.stop)
        known[own_rows] = band.covered
        layer = painted[own_rows]
        layer[band.covered, NORMAL] = turned(layer[band.covered, NORMAL], band.points.interpolate(turns))
    fill(painted, known)


def turned(normals: Float[ndarray, "points 3"], turns: Float[ndarray, "points 2 2"]) -> Float[ndarray, "points 3"]:
    """The normals after turns that were interpolated, and so are a little short."""
    size = np.sqrt(np.abs(np.linalg.det(turns)))[:, None]
    across = np.einsum("pij,pj->pi", turns, normals[:, :2]) / np.maximum(size, 1e-6)
    return np.column_stack([across, normals[:, 2]])


def _turns(
    canvas: Canvas,
    before: Float[ndarray, "faces 3 2"],
    after: Float[ndarray, "faces 3 2"],
    chosen: Bool[ndarray, " mesh_faces"],
) -> Turns:
    """From the frames of some UVs to those of others, at the canvas's faces that are chosen."""
    faces = canvas.mesh.faces[canvas.faces]
    mesh = Mesh(canvas.mesh.positions, faces, np.zeros(len(faces), np.int64), (Part("canvas"),))
    normals = corner_normals(mesh.positions, mesh.faces)
    first, second = (_axes(mesh, normals, uv) for uv in (before, after))
    turns = np.broadcast_to(np.eye(2), (len(canvas.mesh.faces), 3, 2, 2)).copy()
    turns[canvas.faces] = np.einsum("fcix,fcjx->fcij", second, first)
    turns[~chosen] = np.eye(2)
    return turns


def _axes(
    mesh: Mesh, normals: Float[ndarray, "faces 3 3"], uv: Float[ndarray, "faces 3 2"]
) -> Float[ndarray, "faces 3 2 3"]:
    """Tangents and bitangents."""
    tangents = corner_tangents(surface_over(mesh, uv))
    across = tangents.handedness[:, None, None] * np.cross(normals, tangents.direction)
    return np.stack([tangents.direction, across], axis=2)
