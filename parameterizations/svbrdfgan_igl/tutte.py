"""One-to-one maps from which the descent starts: Tutte's map into a circle, in the vehicle's own orientation."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse
from scipy.sparse.linalg import splu

from svbrdfgan_igl.energy import RestTriangles
from svbrdfgan_igl.topology import Disk

_RADIUS = 0.4  # inside the container, whose walls are 0.5 from the origin
MILD = 1e-8
"""Least `mildness` at which rounding does not yet disturb the map."""


def tutte(disk: Disk) -> Float[ndarray, "vertices 2"]:
    """Tutte's map into a circle, turned so that u runs along +X and v along -Z (Tutte 1963).

    Border vertices are spaced on the circle by their distances along the border. Since all weights are positive and the
    border is convex, no triangle is flipped: faces wound counter-clockwise seen from outside are so in UV.
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
    """The least change of a triangle's area under Tutte's map, divided by the greatest; in (0, 1].

    Below `MILD`, which the tips of long rods cause, rounding errors matter.
    """
    det = RestTriangles.of(disk.positions, disk.faces).determinants(tutte(disk))
    return float(det.min() / det.max())


def _circle(disk: Disk) -> Float[ndarray, "loop 2"]:
    """The border on the unit circle, counter-clockwise.

    The circle is turned so that it fits best the directions from the middle to the border, seen from above.
    """
    points = disk.positions[disk.border]
    length = np.linalg.norm(np.roll(points, -1, axis=0) - points, axis=1)
    turn = 2 * np.pi * (np.cumsum(length) - length) / length.sum()
    place = points[:, [0, 2]] - (points.max(axis=0) + points.min(axis=0))[[0, 2]] / 2
    seen = (place[:, 0] - 1j * place[:, 1]) * np.exp(-1j * turn)
    around = (seen * (length + np.roll(length, 1))).sum()
    angle = turn + np.angle(around)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
