"""One-to-one maps to start from: Tutte's, into a circle, in the vehicle's own orientation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse
from scipy.sparse.linalg import splu

from svbrdfgan_igl.energy import RestTriangles
from svbrdfgan_igl.topology import Disk

_RADIUS = 0.4  # inside walls half a unit away
MILD = 1e-8


def tutte(disk: Disk) -> Float[ndarray, "vertices 2"]:
    """The disk in a circle, its border by its length, turned so that u runs along +X and v along -Z (Tutte 1963).

    Seen from above, no triangle is mirrored; with positive weights and a convex border none is flipped.
    """
    uv = np.zeros((len(disk.positions), 2))
    uv[disk.border] = _RADIUS * _circle(disk)
    edges = np.concatenate([disk.faces[:, [0, 1]], disk.faces[:, [1, 2]], disk.faces[:, [2, 0]]])
    row, col = np.concatenate([edges, edges[:, ::-1]]).T
    weight = 1.0 / np.linalg.norm(disk.positions[row] - disk.positions[col], axis=1)
    links = sparse.csr_matrix((weight, (row, col)), shape=(len(uv), len(uv)))
    laplacian = (sparse.diags(np.asarray(links.sum(axis=1)).ravel()) - links).tocsc()
    inner = np.setdiff1d(np.arange(len(uv)), disk.border)
    if len(inner):
        known = -(laplacian[inner][:, disk.border] @ uv[disk.border])
        uv[inner] = splu(laplacian[inner][:, inner].tocsc(), permc_spec="MMD_AT_PLUS_A").solve(known)
    return uv


def mildness(disk: Disk) -> float:
    """How evenly Tutte's map treats triangles: the least over the greatest change of area, in (0, 1].

    Below `MILD`, as at the tips of long rods, rounding begins to count.
    """
    det = RestTriangles.of(disk.positions, disk.faces).determinants(tutte(disk))
    return float(det.min() / det.max())


def _circle(disk: Disk) -> Float[ndarray, "loop 2"]:
    """The border on the unit circle, counter-clockwise, turned to where it lies around the middle, seen from above."""
    points = disk.positions[disk.border]
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    turn = 2 * np.pi * (np.cumsum(length) - length) / length.sum()
    place = points[:, [0, 2]] - (points.max(axis=0) + points.min(axis=0))[[0, 2]] / 2
    seen = (place[:, 0] - 1j * place[:, 1]) * np.exp(-1j * turn)
    around = (seen * (length + np.roll(length, 1))).sum()
    angle = turn + np.angle(around)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
